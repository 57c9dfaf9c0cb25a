"""Charts: a surface cut into pieces, each flattened by itself (xatlas, uvunwrap); `pack.py` arranges them in a page."""

import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.topology import unique_rows
from aoprecalc.subprocesses import FIRST_STEP, POLL_SECONDS, report_step
from aoprecalc.types import BoolArray, Float64Array, Int32Array

Unwrapper = Literal["xatlas", "uvunwrap"]

_ATLASES: list[Any] = []  # every xatlas.Atlas that was made

# xatlas leaves out faces whose area is below FLT_EPSILON, whatever the size of the mesh: meshes about one unit across
# are enlarged until the smallest face is well above that. Powers of two change no digit.
_MIN_AREA = 2.0**-20
_SCALES = 2.0**7, 2.0**20


@dataclass(frozen=True, eq=False)
class Charts:
    """Faces that were cut into charts, which were flattened but not yet packed: in the plane they lie over each other.

    uvs    (f, 3, 2) float64 at the corners of the faces, in the positions' unit of length; (0, 0) in no chart
    chart  (f,) int32: the index of each face's chart, counted from 0; -1 where it is in none, as it has no area
    """

    uvs: Float64Array
    chart: Int32Array

    @property
    def count(self) -> int:
        """Number of charts."""
        return int(self.chart.max(initial=-1)) + 1

    @property
    def placed(self) -> BoolArray:
        """(f,) bool: the faces that are in a chart."""
        in_chart: BoolArray = self.chart >= 0
        return in_chart

    def vertices(self) -> tuple[Float64Array, Int32Array, Int32Array]:
        """Return distinct UVs (v, 2), their charts (v,), and indices into them (p, 3) for the faces in a chart."""
        uvs, chart = self.uvs[self.placed].reshape(-1, 2), np.repeat(self.chart[self.placed], 3)
        first, inverse = unique_rows(chart, uvs)
        return uvs[first], chart[first], inverse.astype(np.int32).reshape(-1, 3)


def make_charts(method: Unwrapper, positions: Float64Array, faces: Int32Array) -> Charts:
    """Cut a mesh into charts and flatten them.

    positions   (v, 3), about one unit across, as both unwrappers compare lengths with constants
    faces       (f, 3) indices into them
    Raises ValueError where the unwrapper fails.
    """
    return _METHODS[method](positions, faces)


def _cut_with_xatlas(positions: Float64Array, faces: Int32Array) -> Charts:
    report_step("charts")
    scale = _scale_for_xatlas(positions[faces])
    atlas = new_xatlas()
    atlas.add_mesh((positions * scale).astype(np.float32), faces.astype(np.uint32))
    atlas.generate()
    _, corners, uvs = atlas.get_mesh(0)
    _, chart = atlas.get_mesh_vertex_assignment(0)
    charts = _from_vertices(uvs.astype(np.float64) * (atlas.width, atlas.height), corners, chart.astype(np.int32))
    return _undo_rounding(charts, positions[faces], atlas.texels_per_unit * scale)


def _scale_for_xatlas(corners: Float64Array) -> float:
    """Return the power of two by which (f, 3, 3) corners are enlarged."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    smallest = areas[areas > 0].min(initial=1.0)
    return float(np.clip(2.0 ** np.ceil(np.log2(_MIN_AREA / smallest) / 2), *_SCALES))


def _undo_rounding(charts: Charts, surface: Float64Array, density: float) -> Charts:
    """Return charts, whose UVs xatlas gave in texels, in the unit of length of the corners of their faces, (f, 3, 3).

    density   texels per unit of length
    xatlas stretches each chart along both axes to whole texels, which makes thin ones much wider. That is undone by the
    two scales a, b within its reach for which (a du)^2 + (b dv)^2 is nearest to the squared length of each edge.
    """
    of_face = charts.chart[charts.placed]
    uvs, corners = charts.uvs[charts.placed], surface[charts.placed] * density
    squared, lengths = ((np.roll(points, -1, axis=1) - points) ** 2 for points in (uvs, corners))
    u, v, length = squared[..., 0], squared[..., 1], lengths.sum(axis=2)
    uu, uv, vv, ul, vl = (
        np.bincount(of_face, product.sum(axis=1), charts.count)
        for product in (u * u, u * v, v * v, u * length, v * length)
    )
    determinant = uu * vv - uv * uv
    solved = determinant > 1e-9 * uu * vv
    safe = np.where(solved, determinant, 1.0)
    scales = np.stack([(vv * ul - uv * vl) / safe, (uu * vl - uv * ul) / safe], axis=1)
    scales = np.where(solved[:, None], np.sqrt(np.maximum(scales, 0.0)), 1.0)
    low, high = (np.full((charts.count, 2), infinity) for infinity in (np.inf, -np.inf))
    np.minimum.at(low, of_face, uvs.min(axis=1))
    np.maximum.at(high, of_face, uvs.max(axis=1))
    texels = np.maximum(np.rint(high - low), 1.0)
    scales = np.clip(scales, np.maximum(1 - 1 / texels, 1e-6), 1.0)
    result: Float64Array = np.zeros_like(charts.uvs)
    result[charts.placed] = (uvs - low[of_face][:, None]) * (scales / density)[of_face][:, None]
    return Charts(result, charts.chart)


def new_xatlas() -> Any:
    """Return an xatlas.Atlas that is never destroyed.

    Its destructor may deadlock on a worker thread that missed its wake-up.
    """
    import xatlas

    _ATLASES.append(xatlas.Atlas())
    return _ATLASES[-1]


def _cut_with_uvunwrap(positions: Float64Array, faces: Int32Array) -> Charts:
    import uvunwrap

    mesh = uvunwrap.Mesh(positions.astype(np.float32), faces.astype(np.uint32))
    atlas = run_uvunwrap(mesh, packing="fast")
    page = atlas.meshes[0]
    flat = np.array(page.uv, np.float64).reshape(-1, 2) * (atlas.width, atlas.height) / atlas.texels_per_unit
    return _from_vertices(flat, np.array(page.indices).reshape(-1, 3), np.array(page.chart, np.int32))


def run_uvunwrap(mesh: Any, **options: Any) -> Any:
    """Return uvunwrap's atlas of a mesh and report its steps meanwhile; raises ValueError where it fails."""
    import uvunwrap

    job = uvunwrap.start([mesh], **options)
    reported = FIRST_STEP
    while not job.done:
        step = _describe(job.progress)
        if step != reported:
            report_step(step)
            reported = step
        time.sleep(POLL_SECONDS)
    try:
        return job.result()
    except uvunwrap.UnwrapError as error:
        raise ValueError(str(error)) from error


def _describe(progress: Any) -> str:
    """Describe the step of a job; its packing counts tries without knowing how many there will be."""
    if progress is None:
        return FIRST_STEP
    count = f"{progress.done} of {progress.total}" if progress.total else f"try {progress.done}"
    return f"{progress.stage}, {count}"


def _from_vertices(flat: Float64Array, corners: NDArray[np.integer], chart: Int32Array) -> Charts:
    """Make charts of flat vertices, (v, 2), the vertices of each face, (f, 3), and each vertex's chart, (v,), or -1."""
    placed = (chart[corners] >= 0).all(axis=1)
    if not placed.any():
        raise ValueError("every face is too thin for it; use a mesh without slivers")
    of_face: Int32Array = np.full(len(corners), -1, np.int32)
    of_face[placed] = np.unique(chart[corners[placed, 0]], return_inverse=True)[1]
    uvs: Float64Array = np.zeros((len(corners), 3, 2))
    uvs[placed] = flat[corners[placed]]
    return Charts(uvs, of_face)


_METHODS = {"xatlas": _cut_with_xatlas, "uvunwrap": _cut_with_uvunwrap}
