"""The atlas in texel coordinates, and the samples in its texels: what both rasterizers of texture space share."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.surface import area_vectors, to_unit_sphere
from aoprecalc.mesh.topology import boundary_edges, face_components
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Int64Array, Scene, Texels

MAX_TILES = 4  # repeats of the texture that a face may span; more are not drawn
_UV_TOLERANCE = 1e-6  # by which rounding may move UVs out of [0, 1]

GRID = 256  # subpixel steps in a texel, to which rasterizers snap corners
CENTER = (0.5, 0.5)  # where a texel is sampled to decide whether it is covered

# Borders, in texels unless said otherwise.
INSET = 1.0 / 512.0  # shrinks a texel's square, so that a border along its side does not cover it
BORDER_OFFSET = 0.2  # distance from a border to its samples, inside the face, unless a limit below is less
MAX_MOVE = 0.4  # greatest distance that a sample moves from the border towards the face's third corner
MAX_SHARE = 0.3  # greatest share of the way from the border to that corner that a sample moves
# Depth in [0, 1] of a border's sample: at the texel's sample, and more for each texel of distance from it.
BORDER_DEPTH = 0.01  # triangles have depth 0
DEPTH_PER_TEXEL = 0.4

# The same numbers under their names in the shaders.
BORDER_RULES = {
    "INSET": INSET,
    "OFFSET": BORDER_OFFSET,
    "MAX_MOVE": MAX_MOVE,
    "MAX_SHARE": MAX_SHARE,
    "BORDER_DEPTH": BORDER_DEPTH,
    "DEPTH_PER_TEXEL": DEPTH_PER_TEXEL,
}

BAND_TEXELS = 1 << 22  # texels drawn at a time: bounds memory
_TILE = 4  # texels a side: 16, as many as a packet has rays
BLOCK = 3 * _TILE  # texels a side: of a group of interleaved directions, every third a side, they fill a packet
_MORTON_BITS = 12  # of a coordinate


@dataclass(frozen=True, eq=False)
class Layout:
    """The triangles and chart borders to rasterize. Texel coordinates: x to the right, y down from the first row.

    triangles      (m, 3, 2) float32; a face across the border of a repeating texture is here once for each tile
    faces          (m,) int32: the face of each triangle
    borders        (e, 3, 2) float32: the edges at which charts end, from and to, and the third corner of their faces
    border_faces   (e,) int32: the face of each border
    border_corners (e,) int32 in 0..2: the border runs from this corner of its face to the next one
    """

    width: int
    height: int
    triangles: Float32Array
    faces: Int32Array
    borders: Float32Array
    border_faces: Int32Array
    border_corners: Int32Array


@dataclass(frozen=True, eq=False)
class Samples:
    """Surface points, one for each of k texels.

    faces     (k,) int32, -1 where the texel has no sample
    weights   (k, 3) float32, barycentric, >= 0, sum 1; (1, 0, 0) where there is no sample
    """

    faces: Int32Array
    weights: Float32Array

    def select(self, rows: slice | BoolArray | NDArray[np.integer]) -> "Samples":
        """Return those of some of the texels."""
        return Samples(self.faces[rows], self.weights[rows])


def keep_faces(samples: Samples, faces: BoolArray) -> Samples:
    """Drop the samples on faces that are not in the mask, (f,) bool."""
    dropped = (samples.faces < 0) | ~faces[samples.faces]
    weights = np.where(dropped[:, None], np.array((1, 0, 0), np.float32), samples.weights)
    return Samples(np.where(dropped, np.int32(-1), samples.faces), weights)


class Rasterizer(Protocol):
    """Finds the surface under the texels of a layout. GLRasterizer uses OpenGL, CPURasterizer does not."""

    def coverage(self) -> Texels:
        """Return the texels whose square the surface touches."""
        ...

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        ...

    def samples(self, texels: Texels, sample_at: tuple[float, float]) -> Samples:
        """Return the surface under `texels`, in any order, at `sample_at` in [0, 1)^2 of their squares."""
        ...


def build_layout(scene: Scene, atlas: Atlas, width: int, height: int) -> Layout:
    """Lay the mapped faces out in a texture of width x height texels."""
    faces = np.flatnonzero(atlas.mapped).astype(np.int32)
    uvs = atlas.uvs[faces]
    is_border = boundary_edges(corner_ids(scene.faces[faces], uvs))
    if atlas.repeats:
        uvs, source = _copy_to_tiles(uvs)
        faces, is_border = faces[source], is_border[source]
    triangles = (uvs * (width, -height) + (0.0, height)).astype(np.float32)
    face, corner = np.nonzero(is_border)
    borders = np.stack([triangles[face, (corner + along) % 3] for along in range(3)], axis=1)
    return Layout(width, height, triangles, faces, borders, faces[face], corner.astype(np.int32))


def atlas_from_uvs(scene: Scene, uvs: Float64Array, mapped: BoolArray) -> Atlas:
    """Make an atlas of existing UVs, (f, 3, 2), for the faces in `mapped`, (f,) bool, at least one."""
    used = uvs[mapped]
    repeats = bool(used.min() < -_UV_TOLERANCE or used.max() > 1 + _UV_TOLERANCE)
    charts = int(face_components(corner_ids(scene.faces[mapped], used)).max()) + 1
    return Atlas("keep", uvs, mapped, charts, repeats=repeats)


def corner_ids(faces: Int32Array, uvs: Float64Array) -> Int32Array:
    """Number corners, (f, 3) int32, so that two are equal where both their position and their UV are."""
    flat = uvs.reshape(-1, 2) - uvs.min(axis=(0, 1))
    rounded = np.round(flat * (2.0**30 / max(1.0, flat.max()))).astype(np.int64)  # u and v fit into one integer
    uv_ids = np.unique(rounded[:, 0] << 31 | rounded[:, 1], return_inverse=True)[1]
    both = faces.ravel().astype(np.int64) * (uv_ids.max() + 1) + uv_ids
    ids: Int32Array = np.unique(both, return_inverse=True)[1].astype(np.int32).reshape(-1, 3)
    return ids


def _copy_to_tiles(uvs: Float64Array) -> tuple[Float64Array, Int32Array]:
    """Move every triangle into the unit square, once for each tile that it reaches; also return its original index."""
    based = uvs - np.floor(uvs.min(axis=1, keepdims=True))
    reach = np.minimum(np.ceil(based.max(axis=1)), MAX_TILES)
    copies, source = [based], [np.arange(len(uvs))]
    for tile_u in range(MAX_TILES):
        for tile_v in range(MAX_TILES):
            if tile_u == tile_v == 0:
                continue
            reaches = np.flatnonzero((reach[:, 0] > tile_u) & (reach[:, 1] > tile_v))
            copies.append(based[reaches] - (tile_u, tile_v))
            source.append(reaches)
    return np.concatenate(copies), np.concatenate(source).astype(np.int32)


def texel_positions(atlas: Atlas, texels: Texels, samples: Samples) -> Float32Array:
    """Return the positions of samples, (k, 2) float32 texels right and down; arbitrary for those without a face."""
    uvs, faces = atlas.uvs, samples.faces
    if len(faces) < len(uvs):
        uvs, faces = uvs[faces], np.arange(len(faces), dtype=np.int32)
    # Wrap UVs into the first tile before rounding to float32, to keep sub-texel precision.
    uvs = uvs - np.floor(uvs.min(axis=1, keepdims=True)) if atlas.repeats else uvs
    corners = (uvs * (texels.width, -texels.height) + (0.0, texels.height)).astype(np.float32)
    # From the first corner along both sides: half the time of a sum over three corners.
    sides = corners[:, 1:] - corners[:, :1]
    positions: Float32Array = np.take(corners[:, 0], faces, axis=0)
    positions += samples.weights[:, 1:2] * np.take(sides[:, 0], faces, axis=0)
    positions += samples.weights[:, 2:3] * np.take(sides[:, 1], faces, axis=0)
    return positions


def doubled_uv_areas(uvs: Float64Array) -> Float64Array:
    """Return twice the area of each of (f, 3, 2) triangles, (f,)."""
    side, other = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    areas: Float64Array = np.abs(side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0])
    return areas


def area_per_texel(scene: Scene, atlas: Atlas, texels: Texels) -> Float64Array:
    """Return the surface area of a texel on each face, (f,) float64, with the mesh scaled to the unit sphere.

    A face smaller than a texel counts as one texel, as it has hardly more than one sample.
    """
    surface = np.linalg.norm(area_vectors(to_unit_sphere(scene.positions)[scene.faces]), axis=1) / 2
    areas: Float64Array = surface / np.maximum(doubled_uv_areas(atlas.uvs) / 2 * texels.width * texels.height, 1.0)
    return areas


# Keep samples off chart borders. At a concave edge a sample on the border lies in the neighbouring face, so that face
# cannot occlude it; samples are moved inwards.


def min_corner_weights(layout: Layout) -> Float32Array:
    """Return the least barycentric weights of samples on each face, (f, 3) float32.

    It is 0 for a corner whose opposite edge is not a chart border. f is one more than the greatest face of the layout.
    A border's samples lie BORDER_OFFSET texels from it, or less where the face is too thin; see border.frag.glsl.
    """
    least: Float32Array = np.zeros((int(layout.faces.max(initial=-1)) + 1, 3), np.float32)
    start, end, apex = layout.borders.transpose(1, 0, 2)
    along, left, right = end - start, apex - start, apex - end
    length = np.maximum(np.hypot(*along.T), 1e-9)
    height = np.maximum(np.abs(along[:, 0] * left[:, 1] - along[:, 1] * left[:, 0]) / length, 1e-9)
    farthest = np.maximum(np.maximum(np.hypot(*left.T), np.hypot(*right.T)), 1e-9)
    shares = np.minimum(MAX_SHARE, np.minimum(BORDER_OFFSET / height, MAX_MOVE / farthest))
    least[layout.border_faces, (layout.border_corners + 2) % 3] = shares
    return least


def move_off_borders(weights: Float32Array, faces: Int32Array, least: Float32Array) -> Float32Array:
    """Raise barycentric weights, (n, 3), to the least ones of their faces; -1 is no face."""
    bordering = np.append(least.any(axis=1), False)  # face -1 (no face) reads the appended False
    close = np.flatnonzero(bordering[faces])
    close = close[(weights[close] < least[faces[close]]).any(axis=1)]
    if not len(close):
        return weights
    moved, lowest = weights[close], least[faces[close]]
    raised = np.maximum(moved, lowest)
    spare = raised - lowest  # what the other corners can give up
    raised -= spare * ((raised.sum(axis=1) - 1) / np.maximum(spare.sum(axis=1), 1e-9))[:, None]
    result = weights.copy()
    result[close] = raised
    return result


def clamp_barycentric(weights: Float32Array) -> Float32Array:
    """Move points onto their faces: all three weights, (n, 3), from those of the last two corners, (2, n)."""
    second, third = np.maximum(weights, 0)
    total = np.maximum(1, second + third)
    second, third = second / total, third / total
    return np.stack([np.maximum(1 - second - third, 0), second, third], axis=1)


# The order of texels.


def row_bands(width: int, height: int) -> list[tuple[int, int]]:
    """Cut a texture into bands of whole rows: the first row of each, and the number of rows.

    Each has at most BAND_TEXELS texels, or one row. Only the last may have fewer rows than the first.
    """
    rows = min(height, max(1, BAND_TEXELS // width))
    return [(row, min(rows, height - row)) for row in range(0, height, rows)]


def order_in_blocks(index: Int64Array, width: int) -> Int64Array:
    """Sort texels by square blocks along a Z-order curve, and by square tiles in these.

    So neighbours read the same part of a depth map, and the rays of a packet start side by side. Measured: the gather
    from maps is a tenth to a quarter faster than in rows; rays are up to a fifth faster than without tiles.

    index   (k,) of the texels, ascending
    """
    row, column = np.divmod(index, width)
    columns = -(-width // BLOCK)
    blocks = np.column_stack(np.divmod(np.arange(columns * (int(row.max(initial=0)) // BLOCK + 1)), columns))
    code = morton_codes(blocks)[row // BLOCK * columns + column // BLOCK]
    for place in (row, column):
        code = code * (BLOCK // _TILE) + place % BLOCK // _TILE
    return index[np.argsort(code, kind="stable")]


def morton_codes(cells: NDArray[np.integer]) -> Int64Array:
    """Return the positions of cells along the Z-order curve, (n,) int64 (G. M. Morton, 1966).

    cells   (n, d) integers in 0 .. 4095, d at most 5
    """
    codes: Int64Array = np.zeros(len(cells), np.int64)
    dimensions = cells.shape[1]
    for axis in range(dimensions):
        for bit in range(_MORTON_BITS):
            codes |= (cells[:, axis].astype(np.int64) >> bit & 1) << (bit * dimensions + axis)
    return codes
