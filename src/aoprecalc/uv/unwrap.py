"""New UVs for a whole scene, packed into one page of exactly the texture's size."""

import io
from typing import Literal

import numpy as np

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, KilledError
from aoprecalc.mesh.normals import face_normals
from aoprecalc.subprocesses import ChildKilledError, ChildTimeoutError, StepCallback, ask, command
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Scene

MIN_SIZE = 16  # texels
_CHILDREN = {method: command("aoprecalc.uv.unwrap_process", method) for method in ("xatlas", "uvunwrap")}
_OTHER = {"xatlas": "uvunwrap", "uvunwrap": "xatlas"}
_IF_SLOW = {"xatlas": "use --unwrap uvunwrap", "uvunwrap": "use a mesh of fewer faces"}


def unwrap(
    scene: Scene,
    method: Literal["xatlas", "uvunwrap"],
    size: int,
    padding: int,
    *,
    timeout: float | None = None,
    on_step: StepCallback | None = None,
) -> Atlas:
    """Cut the scene into charts, flatten them and pack them for a texture whose shorter side is `size` texels.

    padding   texels around each chart that should stay free; see `choose_gutter` for meshes without room for that
    timeout   seconds that the unwrapper may take; None: any number
    on_step   is called several times a second with the step that the unwrapper is at
    Raises InputError where no face has area, UsageError where the size is too small for any chart, AoprecalcError where
    the unwrapper fails or times out. After any exception, Ctrl-C included, the unwrapper is gone.
    """
    if size < MIN_SIZE:
        raise ArgumentError("size", f"is {size}, which has no room for charts and gutters; use at least {MIN_SIZE}")
    mapped = needs_uvs(scene)
    # Both unwrappers compare lengths with constants: they are given a mesh about one unit across.
    used, corners = np.unique(scene.faces[mapped], return_inverse=True)
    positions = scene.positions[used] - scene.positions[used].min(axis=0)
    positions = (positions / positions.max()).astype(np.float32)
    faces = corners.reshape(-1, 3).astype(np.int32)
    try:
        uvs, placed, charts, gutter = _run(method, positions, faces, size, padding, timeout, on_step)
    except ChildTimeoutError as error:
        raise AoprecalcError(
            f"{method} has not unwrapped {len(faces)} faces within {timeout:g} s (--unwrap-timeout), it is at: "
            f"{error.step}; allow more time or {_IF_SLOW[method]}"
        ) from error
    all_uvs: Float64Array = np.zeros((len(scene.faces), 3, 2))
    all_uvs[mapped] = uvs
    mapped[mapped] = placed
    return Atlas(method, all_uvs, mapped, charts, gutter=gutter)


def needs_uvs(scene: Scene) -> BoolArray:
    """Return the faces, (f,) bool, that need UVs of their own: those with area that receive and share no other's UVs.

    Raises InputError where there are none.
    """
    baked = scene.receives & scene.per_face(part.uv_owner is None for part in scene.parts)
    with_area: BoolArray = baked & face_normals(scene.corners)[1]
    if not with_area.any():
        raise InputError(
            f"{scene.path}: none of its {np.count_nonzero(baked)} faces has area; expected a surface to bake"
        )
    return with_area


def _run(
    method: Literal["xatlas", "uvunwrap"],
    positions: Float32Array,
    faces: Int32Array,
    size: int,
    padding: int,
    timeout: float | None,
    on_step: StepCallback | None,
) -> tuple[Float64Array, BoolArray, int, int]:
    """Unwrap in a child process: UVs (f, 3, 2), placed (f,) bool, the number of charts and the gutter."""
    request = io.BytesIO()
    np.savez(request, positions=positions, faces=faces.astype(np.uint32), size=size, padding=padding)
    try:
        answer = np.load(io.BytesIO(ask(_CHILDREN[method], request.getvalue(), on_step, timeout=timeout)))
    except ChildProcessError as error:
        message = f"{method} could not unwrap {len(faces)} faces: {error}; or try --unwrap {_OTHER[method]}"
        raise (KilledError if isinstance(error, ChildKilledError) else AoprecalcError)(message) from error
    return answer["uvs"].astype(np.float64), answer["placed"], int(answer["charts"]), int(answer["gutter"])
