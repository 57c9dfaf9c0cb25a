"""New UVs for a whole scene, in one page of exact size."""

import io
import os
import subprocess
import sys
import time
from typing import Any, Literal

import numpy as np

from aoprecalc.atlas.gutter import LEAST, chart_size, choose_gutter
from aoprecalc.errors import AoprecalcError, InputError, UsageError
from aoprecalc.model import Atlas, Doubles, Floats, Ints, Mask, Scene
from aoprecalc.surface.normals import face_directions

LEAST_SIZE = 16  # texels
_MANY_CHARTS = 1500  # above this, uvunwrap's fast packing: the better one takes longer than the bake
_POLL = 0.05  # seconds
_PACKINGS = 8  # tries at one page
_THINNER = 0.85  # of the density that needed more pages


def unwrap(scene: Scene, method: Literal["xatlas", "uvunwrap"], size: int, padding: int) -> Atlas:
    """Cut the scene into charts, flatten them and pack them for a texture whose shorter side is `size` texels.

    padding   texels around each chart that should stay free; see `choose_gutter` for what happens where room is short
    Raises InputError where no face has area, UsageError where the size is too small for any chart, AoprecalcError where
    the unwrapper fails.
    """
    if size < LEAST_SIZE:
        raise UsageError(f"--size {size} has no room for charts and gutters; use at least {LEAST_SIZE}")
    solid = face_directions(scene.corners)[1]
    if not solid.any():
        raise InputError(f"{scene.path}: none of its {len(scene.faces)} faces has area; expected a surface to unwrap")
    # Both unwrappers weigh lengths against constants; they are given about one unit.
    low = scene.positions.min(axis=0)
    positions = ((scene.positions - low) / np.ptp(scene.positions, axis=0).max()).astype(np.float32)
    engine = _xatlas if method == "xatlas" else _uvunwrap
    uvs, placed, charts, gutter = engine(positions, scene.faces[solid], size, padding)
    everywhere: Doubles = np.zeros((len(scene.faces), 3, 2))
    everywhere[solid] = uvs
    solid[solid] = placed
    return Atlas(method, everywhere, solid, charts, gutter=gutter)


def _xatlas(positions: Floats, faces: Ints, size: int, padding: int) -> tuple[Doubles, Mask, int, int]:
    request = io.BytesIO()
    np.savez(request, positions=positions, faces=faces.astype(np.uint32), size=size, padding=padding)
    command = [sys.executable, "-m", "aoprecalc.atlas.xatlas_child"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}  # finds what this process found
    run = subprocess.run(command, input=request.getvalue(), capture_output=True, check=False, env=environment)
    if run.returncode != 0:
        said = run.stderr.decode(errors="replace").strip().splitlines()
        reason = said[-1] if said else f"exit status {run.returncode}"
        raise AoprecalcError(f"xatlas could not unwrap {len(faces)} faces: {reason}; or try --unwrap uvunwrap")
    answer = np.load(io.BytesIO(run.stdout))
    return answer["uvs"], answer["placed"], int(answer["charts"]), int(answer["gutter"])


def _uvunwrap(positions: Floats, faces: Ints, size: int, padding: int) -> tuple[Doubles, Mask, int, int]:
    mesh = _uvunwrap_mesh(positions, faces)
    # A quick first packing tells how much outline there is, and so how much gutter the page has room for.
    uvs, placed, corners, charts = _run_uvunwrap(mesh, size, LEAST, "fast")
    area, outline = chart_size(uvs[placed] * size, corners[placed])
    gutter = choose_gutter(area, outline, size, padding)
    packing: Literal["shape", "fast"] = "fast" if charts > _MANY_CHARTS else "shape"
    if gutter > LEAST or packing == "shape":
        uvs, placed, corners, charts = _run_uvunwrap(mesh, size, gutter, packing)
    return uvs, placed, charts, gutter


def _uvunwrap_mesh(positions: Floats, faces: Ints) -> Any:
    import uvunwrap

    return uvunwrap.Mesh(positions, faces.astype(np.uint32))


def _run_uvunwrap(
    mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"]
) -> tuple[Doubles, Mask, Ints, int]:
    """Return UVs (f, 3, 2), placed (f,), corner numbers (f, 3) and the number of charts."""
    density = None
    for _ in range(_PACKINGS):
        atlas = _pack_uvunwrap(mesh, size, gutter, packing, density)
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


def _pack_uvunwrap(mesh: Any, size: int, gutter: int, packing: Literal["shape", "fast"], density: float | None) -> Any:
    """Return uvunwrap's atlas, of `density` texels a unit or what it thinks will fit; can be interrupted."""
    import uvunwrap

    job = uvunwrap.start([mesh], page_size=size, padding=gutter, packing=packing, texels_per_unit=density)
    try:
        while not job.done:
            time.sleep(_POLL)
        return job.result()
    except uvunwrap.UnwrapError as error:
        raise AoprecalcError(f"uvunwrap failed ({error}); try --unwrap xatlas") from error
    except KeyboardInterrupt:
        job.cancel()
        raise
