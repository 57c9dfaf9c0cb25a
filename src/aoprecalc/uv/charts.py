"""Charts: a surface cut into pieces, each flattened by itself; `pack.py` arranges them in a page.

xatlas or uvunwrap cut. Faces that they leave out, and charts that prove faulty, are cut into planar charts here.
"""

import time
from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import area_vectors, face_normals
from aoprecalc.mesh.topology import adjacent_half_edges, edge_ids, joined_faces, unique_rows
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.subprocesses import FIRST_STEP, POLL_SECONDS, report_step
from aoprecalc.types import BoolArray, Float64Array, Int32Array
from aoprecalc.uv.polygons import join_polygons

Unwrapper = Literal["xatlas", "uvunwrap"]
Fineness = Literal["coarse", "fine", "planar", "patches", "faces"]
FINER: tuple[Fineness, ...] = (
    "fine",
    "planar",
    "patches",
    "faces",
)  # what faulty charts are cut into, one after the other

MAX_RATIO = 2.0  # between a chart's share of the texture and its share of the surface

_COLLAPSED = 1e-4  # of its share of its chart: a face that is smaller needs another place

_ATLASES: list[Any] = []  # every xatlas.Atlas that was made

# xatlas leaves out faces whose area is below FLT_EPSILON, whatever the size of the mesh: meshes about one unit across
# are enlarged until the smallest face is well above that. Powers of two change no digit.
_MIN_AREA = 2.0**-20
_SCALES = 2.0**7, 2.0**20

# Options for charts that are smaller and stretch less than those of the defaults.
_FINE_XATLAS = {"max_cost": 0.5}
_FINE_UVUNWRAP = {"max_chart_angle": 35.0, "max_area_distortion": 1.5}

_MAX_FACES = {"patches": 16, "faces": 1}  # of planar charts
_MAX_TILT = np.cos(np.radians(25.0))  # between the faces of a planar chart and its plane: it shrinks none below 0.9


@dataclass(frozen=True, eq=False)
class Charts:
    """Faces that were cut into charts, which were flattened but not yet packed: in the plane they lie over each other.

    uvs    (f, 3, 2) float64 at the corners of the faces, in the positions' unit of length; (0, 0) in no chart
    chart  (f,) int32: the index of each face's chart, counted from 0; -1 where it is in none, as it has no area
    Each chart is connected by edges, and its area is that of its faces.
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


def make_charts(
    method: Unwrapper,
    positions: Float64Array,
    faces: Int32Array,
    fineness: Fineness = "coarse",
    polygons: Int32Array | None = None,
) -> Charts:
    """Cut a mesh into charts and flatten them; every face with area gets a place.

    positions   (v, 3), about one unit across, as both unwrappers compare lengths with constants
    faces       (f, 3) indices into them
    fineness    coarse: as the unwrapper does; fine: charts that are smaller and stretch less; planar: plane projections
                of neighbours that are nearly coplanar; patches: of a few of them; faces: each by itself
    polygons    (f,) that of each face, which no seam may cut; None: seams may run between any faces
    Raises ValueError where the unwrapper fails.
    """
    corners = positions[faces]
    with_area = face_normals(corners)[1]
    uvs: Float64Array = np.zeros((len(faces), 3, 2))
    chart: Int32Array = np.full(len(faces), -1, np.int32)
    if fineness in ("coarse", "fine"):
        uvs, chart = _METHODS[method](positions, faces, fineness == "fine")
        chart[_misplaced(uvs, chart, corners)] = -1
    lost = np.flatnonzero(with_area & (chart < 0))
    if len(lost):
        flat, group = _project(corners[lost], faces[lost], _MAX_FACES.get(fineness, len(lost)))
        uvs[lost], chart[lost] = flat, group + chart.max() + 1
    if polygons is not None:
        uvs, chart = join_polygons(uvs, chart, positions, faces, polygons)
    return _finished(uvs, chart, corners)


def cut_again(
    charts: Charts,
    faulty: BoolArray,
    method: Unwrapper,
    positions: Float64Array,
    faces: Int32Array,
    fineness: Fineness,
    polygons: Int32Array | None = None,
) -> Charts:
    """Return the charts with those that are faulty, (n,) bool, cut again; see `make_charts`."""
    chosen = np.append(faulty, False)[charts.chart]  # chart -1 reads the appended False
    used, corners = np.unique(faces[chosen], return_inverse=True)
    size = np.ptp(positions[used], axis=0).max()
    unit = (positions[used] - positions[used].min(axis=0)) / size
    whole = None if polygons is None else polygons[chosen]
    again = make_charts(method, unit, corners.astype(np.int32).reshape(-1, 3), fineness, whole)
    uvs, chart = charts.uvs.copy(), charts.chart.copy()
    uvs[chosen], chart[chosen] = again.uvs, np.where(again.placed, again.chart + charts.count, -1)
    return _finished(uvs, chart, positions[faces])


def _misplaced(uvs: Float64Array, chart: Int32Array, corners: Float64Array) -> BoolArray:
    """Return the faces, (f,) bool, that an unwrapper put into charts out of scale, or that it collapsed."""
    flat, surface = doubled_uv_areas(uvs), np.linalg.norm(area_vectors(corners), axis=1)
    areas, wanted = sum_over_charts(chart, flat), sum_over_charts(chart, surface)
    if not areas.any():
        return chart >= 0
    misplaced: BoolArray = np.append(out_of_scale(areas, wanted), False)[chart]  # chart -1 reads the appended False
    misplaced |= flat * wanted[chart] < _COLLAPSED * surface * areas[chart]
    return misplaced


def _finished(uvs: Float64Array, chart: Int32Array, corners: Float64Array) -> Charts:
    """Return charts that keep what `Charts` promises, from such that may lie apart, in any scale and numbering."""
    placed = chart >= 0
    charts = Charts(uvs, chart)
    vertices = charts.vertices()[2]
    one, other = (half_edge // 3 for half_edge in adjacent_half_edges(vertices))
    piece = joined_faces(len(vertices), one, other)
    flat = sum_over_charts(piece, doubled_uv_areas(uvs[placed]))
    surface = sum_over_charts(piece, np.linalg.norm(area_vectors(corners[placed]), axis=1))
    scale = np.sqrt(surface / np.where(flat > 0, flat, np.inf))
    low: Float64Array = np.full((len(scale), 2), np.inf)
    np.minimum.at(low, piece, uvs[placed].min(axis=1))
    result, pieces = np.zeros_like(uvs), np.full_like(chart, -1)
    result[placed] = (uvs[placed] - low[piece][:, None]) * scale[piece][:, None, None]
    pieces[placed] = piece
    return Charts(result, pieces)


def out_of_scale(areas: Float64Array, surface: Float64Array, negligible: float = 0.0) -> BoolArray:
    """Return which charts' areas, (n,), differ from what their surface, (n,), calls for by more than MAX_RATIO, (n,).

    The scale is the median's, by surface, which a few faulty charts do not move.
    negligible   by how much an area may differ besides
    """
    density = areas / np.where(surface > 0, surface, np.inf)
    order = np.argsort(density)
    below = np.cumsum(surface[order])
    wanted = surface * density[order[np.searchsorted(below, below[-1] / 2)]]
    faulty: BoolArray = (areas > MAX_RATIO * wanted + negligible) | (areas < wanted / MAX_RATIO - negligible)
    return faulty


def sum_over_charts(chart: Int32Array, values: Float64Array) -> Float64Array:
    """Sum values of faces, (f,), over each chart, (n,); chart -1 is none."""
    placed = chart >= 0
    return np.bincount(chart[placed], values[placed], int(chart.max(initial=-1)) + 1).astype(np.float64)


# The unwrappers: (f, 3, 2) UVs, and (f,) the chart of each face or -1.


def _cut_with_xatlas(positions: Float64Array, faces: Int32Array, fine: bool) -> tuple[Float64Array, Int32Array]:
    import xatlas

    report_step("charts")
    options = xatlas.ChartOptions()
    for name, value in _FINE_XATLAS.items() if fine else ():
        setattr(options, name, value)
    scale = _scale_for_xatlas(positions[faces])
    atlas = new_xatlas()
    atlas.add_mesh((positions * scale).astype(np.float32), faces.astype(np.uint32))
    atlas.generate(options)
    _, vertices, uvs = atlas.get_mesh(0)
    _, of_vertex = atlas.get_mesh_vertex_assignment(0)
    flat, chart = _at_corners(
        uvs.astype(np.float64) * (atlas.width, atlas.height), vertices, of_vertex.astype(np.int32)
    )
    return _undo_rounding(flat, chart, positions[faces] * (atlas.texels_per_unit * scale)), chart


def _scale_for_xatlas(corners: Float64Array) -> float:
    """Return the power of two by which (f, 3, 3) corners are enlarged."""
    areas = np.linalg.norm(area_vectors(corners), axis=1) / 2
    smallest = areas[areas > 0].min(initial=1.0)
    return float(np.clip(2.0 ** np.ceil(np.log2(_MIN_AREA / smallest) / 2), *_SCALES))


def _undo_rounding(uvs: Float64Array, chart: Int32Array, corners: Float64Array) -> Float64Array:
    """Return (f, 3, 2) UVs in texels without the stretch that xatlas gives each chart along both axes.

    corners  (f, 3, 3) corners of the faces, in the same scale
    It makes charts a whole number of texels wide and high, so thin ones much wider. The two scales a, b of a chart are
    those within its reach for which (a du)^2 + (b dv)^2 is nearest to the squared length of each edge.
    """
    placed, count = chart >= 0, int(chart.max(initial=-1)) + 1
    of_face, flat = chart[placed], uvs[placed]
    squared, lengths = ((np.roll(points, -1, axis=1) - points) ** 2 for points in (flat, corners[placed]))
    u, v, length = squared[..., 0], squared[..., 1], lengths.sum(axis=2)
    uu, uv, vv, ul, vl = (
        np.bincount(of_face, product.sum(axis=1), count) for product in (u * u, u * v, v * v, u * length, v * length)
    )
    determinant = uu * vv - uv * uv
    solved = determinant > 1e-9 * uu * vv
    safe = np.where(solved, determinant, 1.0)
    scales = np.stack([(vv * ul - uv * vl) / safe, (uu * vl - uv * ul) / safe], axis=1)
    scales = np.where(solved[:, None], np.sqrt(np.maximum(scales, 0.0)), 1.0)
    low, high = (np.full((count, 2), infinity) for infinity in (np.inf, -np.inf))
    np.minimum.at(low, of_face, flat.min(axis=1))
    np.maximum.at(high, of_face, flat.max(axis=1))
    texels = np.maximum(np.rint(high - low), 1.0)
    result = uvs.copy()
    result[placed] *= np.clip(scales, np.maximum(1 - 1 / texels, 1e-6), 1.0)[of_face][:, None]
    return result


def new_xatlas() -> Any:
    """Return an xatlas.Atlas that is never destroyed.

    Its destructor may deadlock on a worker thread that missed its wake-up.
    """
    import xatlas

    _ATLASES.append(xatlas.Atlas())
    return _ATLASES[-1]


def _cut_with_uvunwrap(positions: Float64Array, faces: Int32Array, fine: bool) -> tuple[Float64Array, Int32Array]:
    import uvunwrap

    mesh = uvunwrap.Mesh(positions.astype(np.float32), faces.astype(np.uint32))
    atlas = run_uvunwrap(mesh, packing="fast", **(_FINE_UVUNWRAP if fine else {}))
    page = atlas.meshes[0]
    flat = np.array(page.uv, np.float64).reshape(-1, 2) * (atlas.width, atlas.height)
    return _at_corners(flat, np.array(page.indices).reshape(-1, 3), np.array(page.chart, np.int32))


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


def _at_corners(
    flat: Float64Array, vertices: NDArray[np.integer], of_vertex: Int32Array
) -> tuple[Float64Array, Int32Array]:
    """Return UVs (f, 3, 2) and charts (f,) of faces from those of vertices, (v, 2) and (v,) or -1."""
    placed = (of_vertex[vertices] >= 0).all(axis=1)
    uvs: Float64Array = np.where(placed[:, None, None], flat[vertices], 0.0)
    chart: Int32Array = np.where(placed, of_vertex[vertices[:, 0]], -1).astype(np.int32)
    return uvs, chart


_METHODS = {"xatlas": _cut_with_xatlas, "uvunwrap": _cut_with_uvunwrap}


# Planar charts.


def _project(corners: Float64Array, vertices: Int32Array, most: int) -> tuple[Float64Array, Int32Array]:
    """Project faces with area, (f, 3, 3), onto planes: (f, 3, 2) UVs in the corners' unit, and (f,) groups from 0.

    vertices   (f, 3) indices of the corners' positions
    most       faces of a group
    """
    normals = face_normals(corners)[0]
    group, seeds = _coplanar_groups(corners, vertices, normals, most)
    sides = np.roll(corners[seeds], -1, axis=1) - corners[seeds]
    longest = np.linalg.norm(sides, axis=2).argmax(axis=1)
    across = sides[np.arange(len(seeds)), longest]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    axes = np.stack([across, np.cross(normals[seeds], across)], axis=1)
    from_seed = corners - corners[seeds[group], :1]
    uvs: Float64Array = np.einsum("fcx,fax->fca", from_seed, axes[group])
    return uvs, group.astype(np.int32)


def _coplanar_groups(
    corners: Float64Array, vertices: Int32Array, normals: Float64Array, most: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Group faces: (f,) groups from 0, and the seed of each, the face from which it grew, the largest first.

    A group grows to `most` faces, over edges at which exactly two faces meet whose windings agree, to faces that are
    nearly parallel to its seed, so that its projection onto the seed's plane does not fold.
    """
    one, other = adjacent_half_edges(vertices)
    edges = edge_ids(vertices).ravel()
    agreeing = (np.bincount(edges)[edges[one]] == 2) & (vertices.ravel()[one] != vertices.ravel()[other])
    neighbours: list[list[int]] = [[] for _ in vertices]
    for left, right in zip((one[agreeing] // 3).tolist(), (other[agreeing] // 3).tolist(), strict=True):
        neighbours[left].append(right)
        neighbours[right].append(left)
    group, directions = [-1] * len(vertices), normals.tolist()
    seeds: list[int] = []
    for seed in np.argsort(-np.linalg.norm(area_vectors(corners), axis=1), kind="stable").tolist():
        if group[seed] >= 0:
            continue
        x, y, z = directions[seed]
        waiting, room = deque([seed]), most
        while waiting and room:
            face = waiting.popleft()
            u, v, w = directions[face]
            if group[face] < 0 and u * x + v * y + w * z >= _MAX_TILT:
                group[face] = len(seeds)
                waiting += neighbours[face]
                room -= 1
        seeds.append(seed)
    return np.array(group, np.intp), np.array(seeds, np.intp)
