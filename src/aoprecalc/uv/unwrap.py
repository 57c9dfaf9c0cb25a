"""New UVs for a whole scene, in one page of exact size."""

import io
import time
from typing import Literal

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError, KilledError, UsageError
from aoprecalc.mesh.normals import face_normals
from aoprecalc.subprocesses import ChildKilledError, StepCallback, ask, command
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Scene

MIN_SIZE = 16  # texels
_CHILDREN = {name: command(f"aoprecalc.uv.{name}_process") for name in ("xatlas", "uvunwrap")}
_OTHER = {"xatlas": "uvunwrap", "uvunwrap": "xatlas"}
_ELSE = {"xatlas": "use --unwrap uvunwrap", "uvunwrap": "use a mesh of fewer faces"}  # where time is short


def unwrap(
    scene: Scene,
    method: Literal["xatlas", "uvunwrap"],
    size: int,
    padding: int,
    *,
    seconds: float | None = None,
    heard: StepCallback | None = None,
) -> Atlas:
    """Cut the scene into charts, flatten them and pack them for a texture whose shorter side is `size` texels.

    padding   texels around each chart that should stay free; see `choose_gutter` for what happens where room is short
    seconds   that the unwrapper may take; None: any
    heard     is called with the step that the unwrapper is at, several times a second
    Raises InputError where no face has area, UsageError where the size is too small for any chart, AoprecalcError where
    the unwrapper fails or its time is over. No unwrapper goes on after an error, a Ctrl-C included.
    """
    if size < MIN_SIZE:
        raise UsageError(f"--size {size} has no room for charts and gutters; use at least {MIN_SIZE}")
    solid = needs_uvs(scene)
    # Both unwrappers weigh lengths against constants; they are given about one unit.
    used, corners = np.unique(scene.faces[solid], return_inverse=True)
    positions = scene.positions[used] - scene.positions[used].min(axis=0)
    positions = (positions / positions.max()).astype(np.float32)
    faces = corners.reshape(-1, 3).astype(np.int32)
    started = time.monotonic()

    def look(step: str) -> None:
        if heard is not None:
            heard(step)
        if seconds is not None and time.monotonic() - started > seconds:
            raise AoprecalcError(
                f"{method} has not unwrapped {len(faces)} faces within {seconds:g} s (--unwrap-timeout), it is at: "
                f"{step}; allow more time or {_ELSE[method]}"
            )

    uvs, placed, charts, gutter = _ask(method, positions, faces, size, padding, look)
    everywhere: Float64Array = np.zeros((len(scene.faces), 3, 2))
    everywhere[solid] = uvs
    solid[solid] = placed
    return Atlas(method, everywhere, solid, charts, gutter=gutter)


def needs_uvs(scene: Scene) -> BoolArray:
    """Return the faces, (f,) bool, that need a place in the texture: those with area that receive and share none.

    Raises InputError where there are none.
    """
    there = scene.receives & scene.per_face(part.uv_owner is None for part in scene.parts)
    solid: BoolArray = there & face_normals(scene.corners)[1]
    if not solid.any():
        raise InputError(
            f"{scene.path}: none of its {np.count_nonzero(there)} faces has area; expected a surface to bake"
        )
    return solid


def _ask(
    method: Literal["xatlas", "uvunwrap"],
    positions: Float32Array,
    faces: Int32Array,
    size: int,
    padding: int,
    look: StepCallback,
) -> tuple[Float64Array, BoolArray, int, int]:
    """Return UVs (f, 3, 2), placed (f,), the number of charts and the gutter, from a process of the unwrapper's own."""
    request = io.BytesIO()
    np.savez(request, positions=positions, faces=faces.astype(np.uint32), size=size, padding=padding)
    try:
        answer = np.load(io.BytesIO(ask(_CHILDREN[method], request.getvalue(), look)))
    except ChildProcessError as error:
        message = f"{method} could not unwrap {len(faces)} faces: {error}; or try --unwrap {_OTHER[method]}"
        raise (KilledError if isinstance(error, ChildKilledError) else AoprecalcError)(message) from error
    return answer["uvs"].astype(np.float64), answer["placed"], int(answer["charts"]), int(answer["gutter"])
