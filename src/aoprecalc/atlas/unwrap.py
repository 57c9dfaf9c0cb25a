"""New UVs for a whole scene, in one page of exact size."""

import io
import sys
import time
from typing import Any, Literal

import numpy as np

from aoprecalc.atlas.child import FIRST_STEP, POLL, Look, ask
from aoprecalc.atlas.gutter import LEAST, chart_size, choose_gutter
from aoprecalc.errors import AoprecalcError, InputError, UsageError
from aoprecalc.model import Atlas, Doubles, Floats, Ints, Mask, Scene
from aoprecalc.surface.normals import face_directions

LEAST_SIZE = 16  # texels
_MANY_CHARTS = 1500  # above this, uvunwrap's fast packing: the better one takes longer than the bake
_PACKINGS = 8  # tries at one page
_THINNER = 0.85  # of the density that needed more pages
_XATLAS = [sys.executable, "-P", "-m", "aoprecalc.atlas.xatlas_child"]  # -P: no modules of the current folder
_ELSE = {"xatlas": "use --unwrap uvunwrap", "uvunwrap": "use a mesh of fewer faces"}  # where time is short


def unwrap(
    scene: Scene,
    method: Literal["xatlas", "uvunwrap"],
    size: int,
    padding: int,
    *,
    seconds: float | None = None,
    heard: Look | None = None,
) -> Atlas:
    """Cut the scene into charts, flatten them and pack them for a texture whose shorter side is `size` texels.

    padding   texels around each chart that should stay free; see `choose_gutter` for what happens where room is short
    seconds   that the unwrapper may take; None: any
    heard     is called with the step that the unwrapper is at, several times a second
    Raises InputError where no face has area, UsageError where the size is too small for any chart, AoprecalcError where
    the unwrapper fails or its time is over. No unwrapper goes on after an error, a Ctrl-C included.
    """
    if size < LEAST_SIZE:
        raise UsageError(f"--size {size} has no room for charts and gutters; use at least {LEAST_SIZE}")
    solid = owns_place(scene)
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

    engine = _xatlas if method == "xatlas" else _uvunwrap
    uvs, placed, charts, gutter = engine(positions, faces, size, padding, look)
    everywhere: Doubles = np.zeros((len(scene.faces), 3, 2))
    everywhere[solid] = uvs
    solid[solid] = placed
    return Atlas(method, everywhere, solid, charts, gutter=gutter)


def owns_place(scene: Scene) -> Mask:
    """Return the faces, (f,) bool, that need a place in the texture: those with area that receive and share none.

    Raises InputError where there are none.
    """
    there = scene.receives & scene.of_parts(part.shares is None for part in scene.parts)
    solid: Mask = there & face_directions(scene.corners)[1]
    if not solid.any():
        raise InputError(
            f"{scene.path}: none of its {np.count_nonzero(there)} faces has area; expected a surface to bake"
        )
    return solid


def _xatlas(positions: Floats, faces: Ints, size: int, padding: int, look: Look) -> tuple[Doubles, Mask, int, int]:
    request = io.BytesIO()
    np.savez(request, positions=positions, faces=faces.astype(np.uint32), size=size, padding=padding)
    try:
        answer = np.load(io.BytesIO(ask(_XATLAS, request.getvalue(), look)))
    except ChildProcessError as error:
        message = f"xatlas could not unwrap {len(faces)} faces: {error}; or try --unwrap uvunwrap"
        raise AoprecalcError(message) from error
    return answer["uvs"], answer["placed"], int(answer["charts"]), int(answer["gutter"])


def _uvunwrap(positions: Floats, faces: Ints, size: int, padding: int, look: Look) -> tuple[Doubles, Mask, int, int]:
    mesh = _uvunwrap_mesh(positions, faces)
    # A quick first packing tells how much outline there is, and so how much gutter the page has room for.
    uvs, placed, corners, charts = _run_uvunwrap(mesh, size, LEAST, "fast", look)
    area, outline = chart_size(uvs[placed] * size, corners[placed])
    gutter = choose_gutter(area, outline, size, padding)
    packing: Literal["shape", "fast"] = "fast" if charts > _MANY_CHARTS else "shape"
    if gutter > LEAST or packing == "shape":
        uvs, placed, corners, charts = _run_uvunwrap(mesh, size, gutter, packing, look)
    return uvs, placed, charts, gutter


def _uvunwrap_mesh(positions: Floats, faces: Ints) -> Any:
    import uvunwrap

    return uvunwrap.Mesh(positions, faces.astype(np.uint32))


def _run_uvunwrap(
    mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"], look: Look
) -> tuple[Doubles, Mask, Ints, int]:
    """Return UVs (f, 3, 2), placed (f,), corner numbers (f, 3) and the number of charts."""
    density = None
    for _ in range(_PACKINGS):
        atlas = _pack_uvunwrap(mesh, size, gutter, packing, density, look)
        if atlas.page_count == 1:
            break
        density = _THINNER * atlas.texels_per_unit
    else:
        raise AoprecalcError(f"the charts need {atlas.page_count} pages of {size} x {size} texels; use a larger --size")
    page = atlas.meshes[0]
    corners: Ints = np.array(page.indices, np.int32).reshape(-1, 3)
    placed: Mask = (np.array(page.page)[corners] == 0).all(axis=1)
    uvs = np.array(page.uv, np.float64).reshape(-1, 2)[corners] * (atlas.width / size, atlas.height / size)
    return uvs, placed, corners, atlas.chart_count


def _pack_uvunwrap(
    mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"], density: float | None, look: Look
) -> Any:
    """Return uvunwrap's atlas, of `density` texels a unit or what it thinks will fit; can be interrupted."""
    import uvunwrap

    job = uvunwrap.start([mesh], page_size=size, padding=gutter, packing=packing, texels_per_unit=density)
    try:
        while not job.done:
            look(_step(job.progress))
            time.sleep(POLL)
        return job.result()
    except uvunwrap.UnwrapError as error:
        raise AoprecalcError(f"uvunwrap failed ({error}); try --unwrap xatlas") from error
    except BaseException:
        job.cancel()
        raise


def _step(progress: Any) -> str:
    """Say in words what uvunwrap's job is at; its packing counts tries and does not know how many there will be."""
    if progress is None:
        return FIRST_STEP
    count = f"{progress.done} of {progress.total}" if progress.total else f"try {progress.done}"
    return f"{progress.stage}, {count}"
