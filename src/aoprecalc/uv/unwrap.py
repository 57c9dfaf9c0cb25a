"""New UVs for a whole scene, packed into one page of the texture's size, and the gutters between their charts."""

import io
import math
from typing import Literal

import numpy as np

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, KilledError, counted
from aoprecalc.mesh.normals import face_normals
from aoprecalc.mesh.topology import boundary_edges
from aoprecalc.subprocesses import ChildKilledError, ChildTimeoutError, StepCallback, ask, command
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Scene

MIN_SIZE = 16  # texels
MIN_GUTTER = 2  # texels: with fewer, bilinear filtering would mix charts at full resolution
_MAX_SHARE = 1.0 / 3.0  # of the atlas
_EFFICIENCY = 0.7  # share of the atlas that packers fill with charts and their gutters
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
            f"{method} has not unwrapped {counted(len(faces), 'face')} within {timeout:g} s (--unwrap-timeout), "
            f"it is at: {error.step}; allow more time or {_IF_SLOW[method]}"
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
            f"{scene.path}: none of {counted(np.count_nonzero(baked), 'face')} has area; expected a surface to bake"
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
        message = f"{method} could not unwrap {counted(len(faces), 'face')}: {error}; or try --unwrap {_OTHER[method]}"
        raise (KilledError if isinstance(error, ChildKilledError) else AoprecalcError)(message) from error
    return answer["uvs"].astype(np.float64), answer["placed"], int(answer["charts"]), int(answer["gutter"])


# Gutters: how wide they are, and to which mip level they keep charts apart.


def choose_gutter(area: float, perimeter: float, size: int, padding: int) -> int:
    """Return the gutter in texels: twice the padding, but less where gutters would take over a third of the atlas.

    area, perimeter   of all charts together, in any unit of length, squared for the area
    size              side of the square atlas in texels
    """
    gutter = max(MIN_GUTTER, 2 * padding)
    while gutter > MIN_GUTTER and _gutter_share(area, perimeter, size, gutter) > _MAX_SHARE:
        gutter -= 1
    return gutter


def first_unsafe_mip(gutter: int, padding: int) -> int:
    """Return the first mip level at which filtering may mix charts, or a chart with the fill beyond its padding.

    Level k needs about 1.5 * 2**k texels a side, both of half the gutter and of the padding; one is enough for level 0.
    """
    if padding == 0:
        return 0
    level = 1
    while 1.5 * 2**level <= min(gutter / 2, padding):
        level += 1
    return level


def area_and_perimeter(uvs: Float64Array, corners: Int32Array) -> tuple[float, float]:
    """Return the area and the outline length of all charts, for (f, 3, 2) UVs and (f, 3) vertex indices."""
    lengths = np.linalg.norm(np.roll(uvs, -1, axis=1) - uvs, axis=2)
    return float(0.5 * doubled_uv_areas(uvs).sum()), float(lengths[boundary_edges(corners)].sum())


def doubled_uv_areas(uvs: Float64Array) -> Float64Array:
    """Return twice the area of each of (f, 3, 2) triangles, (f,)."""
    side, other = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    areas: Float64Array = np.abs(side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0])
    return areas


def fitting_scale(area: float, perimeter: float, size: int, gutter: int) -> float:
    """Return the factor t by which charts can grow: area t^2 + perimeter gutter t = efficiency size^2.

    Two charts share the gutter between them, but packers nest real outlines so loosely that each takes the whole of it
    (measured: 3,600 small charts lose 0.34 of a page to gutters of 4 texels where half the perimeter predicts 0.18).
    """
    strip = perimeter * gutter / 2
    return (math.sqrt(strip**2 + area * _EFFICIENCY * size**2) - strip) / area


def _gutter_share(area: float, perimeter: float, size: int, gutter: int) -> float:
    """Return the share of the atlas that gutters take when the charts are as large as they can be."""
    return fitting_scale(area, perimeter, size, gutter) * perimeter * gutter / size**2
