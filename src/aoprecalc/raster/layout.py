"""The triangles and chart borders of an atlas, laid out in texels."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.mesh.normals import area_vectors
from aoprecalc.mesh.topology import boundary_edges, face_components
from aoprecalc.mesh.unit_sphere import to_unit_sphere
from aoprecalc.raster.samples import ASIDE, DEEPEST, INWARD, Samples
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Scene, Texels

MAX_TILES = 4  # repeats of the texture that a face may span; more are not drawn
_BEYOND = 1e-6  # by which rounding may move UVs out of [0, 1]


@dataclass(frozen=True, eq=False)
class Layout:
    """What is drawn into texture space. Texel coordinates: x to the right, y down from the first row of the picture.

    triangles      (m, 3, 2) float32; a face that crosses the border of a repeating texture is here once for each tile
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


def build_layout(scene: Scene, atlas: Atlas, width: int, height: int) -> Layout:
    """Place the faces that the atlas covers into a texture of width x height texels."""
    faces = np.flatnonzero(atlas.mapped).astype(np.int32)
    uvs = atlas.uvs[faces]
    is_border = boundary_edges(corner_ids(scene.faces[faces], uvs))
    if atlas.repeats:
        uvs, source = _wrap(uvs)
        faces, is_border = faces[source], is_border[source]
    triangles = (uvs * (width, -height) + (0.0, height)).astype(np.float32)
    face, corner = np.nonzero(is_border)
    border_places = np.stack([triangles[face, (corner + along) % 3] for along in range(3)], axis=1)
    return Layout(width, height, triangles, faces, border_places, faces[face], corner.astype(np.int32))


def atlas_from_uvs(scene: Scene, uvs: Float64Array, mapped: BoolArray) -> Atlas:
    """Take UVs as they are, (f, 3, 2), for the atlas of the faces in `covers`, (f,) bool, of which there are some."""
    used = uvs[mapped]
    repeats = bool(used.min() < -_BEYOND or used.max() > 1 + _BEYOND)
    charts = int(face_components(corner_ids(scene.faces[mapped], used)).max()) + 1
    return Atlas("keep", uvs, mapped, charts, repeats=repeats)


def corner_ids(faces: Int32Array, uvs: Float64Array) -> Int32Array:
    """Number corners, (f, 3) int32, so that two agree where both their position and their UV agree."""
    flat = uvs.reshape(-1, 2) - uvs.min(axis=(0, 1))
    place = np.round(flat * (2.0**30 / max(1.0, flat.max()))).astype(np.int64)  # two of them fit one number
    uv_ids = np.unique(place[:, 0] << 31 | place[:, 1], return_inverse=True)[1]
    both = faces.ravel().astype(np.int64) * (uv_ids.max() + 1) + uv_ids
    ids: Int32Array = np.unique(both, return_inverse=True)[1].astype(np.int32).reshape(-1, 3)
    return ids


def _wrap(uvs: Float64Array) -> tuple[Float64Array, Int32Array]:
    """Move every triangle into the unit square, once for each tile that it reaches; also returns which one each was."""
    based = uvs - np.floor(uvs.min(axis=1, keepdims=True))
    reach = np.minimum(np.ceil(based.max(axis=1)), MAX_TILES)
    placed, source = [based], [np.arange(len(uvs))]
    for tile_u in range(MAX_TILES):
        for tile_v in range(MAX_TILES):
            if tile_u == tile_v == 0:
                continue
            reaches = np.flatnonzero((reach[:, 0] > tile_u) & (reach[:, 1] > tile_v))
            placed.append(based[reaches] - (tile_u, tile_v))
            source.append(reaches)
    return np.concatenate(placed), np.concatenate(source).astype(np.int32)


# Where samples lie in the texture, and how much surface they stand for.


def texel_positions(atlas: Atlas, texels: Texels, samples: Samples) -> Float32Array:
    """Return where samples lie, (k, 2) float32 texels right and down; any place for those without a face."""
    # Near the origin first: 32 bits do not resolve a texel far from it, and which repeat it is does not matter.
    uvs = atlas.uvs - np.floor(atlas.uvs.min(axis=1, keepdims=True)) if atlas.repeats else atlas.uvs
    corners = (uvs * (texels.width, -texels.height) + (0.0, texels.height)).astype(np.float32)
    # From the first corner along both sides: half the time of a sum over three corners.
    sides = corners[:, 1:] - corners[:, :1]
    where: Float32Array = np.take(corners[:, 0], samples.faces, axis=0)
    where += samples.weights[:, 1:2] * np.take(sides[:, 0], samples.faces, axis=0)
    where += samples.weights[:, 2:3] * np.take(sides[:, 1], samples.faces, axis=0)
    return where


def area_per_texel(scene: Scene, atlas: Atlas, texels: Texels) -> Float64Array:
    """Return the area of surface that a sample on each face stands for, (f,) float64, with the mesh in the unit sphere.

    A face of less than a texel is taken for one, as it has hardly more than one sample.
    """
    surface = np.linalg.norm(area_vectors(to_unit_sphere(scene.positions)[scene.faces]), axis=1) / 2
    first, second = atlas.uvs[:, 1] - atlas.uvs[:, 0], atlas.uvs[:, 2] - atlas.uvs[:, 0]
    share = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    stands_for: Float64Array = surface / np.maximum(share * texels.width * texels.height, 1.0)
    return stands_for


# Keeps samples off chart borders: at a crease, a point there would lie in the very wall that ought to hide it.


def min_corner_weights(layout: Layout) -> Float32Array:
    """Return how much of each corner the samples on a face must have, (f, 3) float32, 0 where no border is opposite.

    f is one more than the greatest face of the layout. A border's samples lie INWARD texels from it, or less where the
    face is too thin for that; see border.frag.glsl.
    """
    least: Float32Array = np.zeros((int(layout.faces.max(initial=-1)) + 1, 3), np.float32)
    start, end, apex = layout.borders.transpose(1, 0, 2)
    along, left, right = end - start, apex - start, apex - end
    length = np.maximum(np.hypot(*along.T), 1e-9)
    height = np.maximum(np.abs(along[:, 0] * left[:, 1] - along[:, 1] * left[:, 0]) / length, 1e-9)
    farthest = np.maximum(np.maximum(np.hypot(*left.T), np.hypot(*right.T)), 1e-9)
    shares = np.minimum(DEEPEST, np.minimum(INWARD / height, ASIDE / farthest))
    least[layout.border_faces, (layout.border_corners + 2) % 3] = shares
    return least


def move_off_borders(weights: Float32Array, faces: Int32Array, least: Float32Array) -> Float32Array:
    """Return (n, 3) weights of samples moved away from the borders of their faces; -1 is no face."""
    bordering = np.append(least.any(axis=1), False)  # the last one for those without a face
    close = np.flatnonzero(bordering[faces])
    close = close[(weights[close] < least[faces[close]]).any(axis=1)]
    if not len(close):
        return weights
    moved, lowest = weights[close], least[faces[close]]
    raised = np.maximum(moved, lowest)
    spare = raised - lowest  # what the other corners can give
    raised -= spare * ((raised.sum(axis=1) - 1) / np.maximum(spare.sum(axis=1), 1e-9))[:, None]
    result = weights.copy()
    result[close] = raised
    return result
