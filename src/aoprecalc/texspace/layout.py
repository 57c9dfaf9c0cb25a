"""The triangles and chart borders of an atlas, laid out in texels."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.model import Atlas, Doubles, Floats, Ints, Mask, Scene
from aoprecalc.surface.topology import borders, islands

MOST_TILES = 4  # repeats of the texture that a face may span; more are not drawn
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
    triangles: Floats
    faces: Ints
    borders: Floats
    border_faces: Ints
    border_corners: Ints


def lay_out(scene: Scene, atlas: Atlas, width: int, height: int) -> Layout:
    """Place the faces that the atlas covers into a texture of width x height texels."""
    faces = np.flatnonzero(atlas.covers).astype(np.int32)
    uvs = atlas.uvs[faces]
    is_border = borders(corner_ids(scene.faces[faces], uvs))
    if atlas.wraps:
        uvs, source = _wrap(uvs)
        faces, is_border = faces[source], is_border[source]
    triangles = (uvs * (width, -height) + (0.0, height)).astype(np.float32)
    face, corner = np.nonzero(is_border)
    border_places = np.stack([triangles[face, (corner + along) % 3] for along in range(3)], axis=1)
    return Layout(width, height, triangles, faces, border_places, faces[face], corner.astype(np.int32))


def as_atlas(scene: Scene, uvs: Doubles, covers: Mask) -> Atlas:
    """Take UVs as they are, (f, 3, 2), for the atlas of the faces in `covers`, (f,) bool, of which there are some."""
    used = uvs[covers]
    repeats = bool(used.min() < -_BEYOND or used.max() > 1 + _BEYOND)
    charts = int(islands(corner_ids(scene.faces[covers], used)).max()) + 1
    return Atlas("keep", uvs, covers, charts, wraps=repeats)


def corner_ids(faces: Ints, uvs: Doubles) -> Ints:
    """Number corners, (f, 3) int32, so that two agree where both their position and their UV agree."""
    flat = uvs.reshape(-1, 2) - uvs.min(axis=(0, 1))
    place = np.round(flat * (2.0**30 / max(1.0, flat.max()))).astype(np.int64)  # two of them fit one number
    uv_ids = np.unique(place[:, 0] << 31 | place[:, 1], return_inverse=True)[1]
    both = faces.ravel().astype(np.int64) * (uv_ids.max() + 1) + uv_ids
    ids: Ints = np.unique(both, return_inverse=True)[1].astype(np.int32).reshape(-1, 3)
    return ids


def _wrap(uvs: Doubles) -> tuple[Doubles, Ints]:
    """Move every triangle into the unit square, once for each tile that it reaches; also returns which one each was."""
    based = uvs - np.floor(uvs.min(axis=1, keepdims=True))
    reach = np.minimum(np.ceil(based.max(axis=1)), MOST_TILES)
    placed, source = [based], [np.arange(len(uvs))]
    for tile_u in range(MOST_TILES):
        for tile_v in range(MOST_TILES):
            if tile_u == tile_v == 0:
                continue
            reaches = np.flatnonzero((reach[:, 0] > tile_u) & (reach[:, 1] > tile_v))
            placed.append(based[reaches] - (tile_u, tile_v))
            source.append(reaches)
    return np.concatenate(placed), np.concatenate(source).astype(np.int32)
