"""UDIM tiles: unit squares of UV space, each with a texture of its own (Mari, The Foundry).

A file's UVs are on UDIM tiles, and not on one texture that repeats, if

- each face lies within one tile, and so does each polygon of the file,
- they use more than one, of those that have a number: 1001 + column + 10 row, with columns 0 to 9 and rows from 0,
- wrapped modulo 1 the tiles overlap, so that one texture could not hold their bake, but each can hold its own.
"""

from dataclasses import dataclass, replace

import numpy as np

from aoprecalc.types import BoolArray, Float64Array, Int64Array, Scene
from aoprecalc.uv.checks import RasterizerFactory, check_uvs, needs_uvs

_COLUMNS, _FIRST, _LAST = 10, 1001, 9999
_ROUNDING = 1e-5  # by which UVs may leave their tile


@dataclass(frozen=True, eq=False)
class UdimTile:
    """A tile that the UVs of a file use.

    number   1001 is that of [0, 1] x [0, 1]
    uv_set   index of the set of UVs
    faces    (f,) bool: the faces on it
    corner   (2,) float64: its least UVs
    """

    number: int
    uv_set: int
    faces: BoolArray
    corner: Float64Array

    def scene(self, scene: Scene) -> Scene:
        """Return the scene in which only its faces receive, with the UVs in the tile as the only ones with area."""
        uvs = np.where(self.faces[:, None, None], scene.uv_sets[self.uv_set] - self.corner, 0.0).clip(0.0, 1.0)
        others = tuple(np.zeros_like(uvs) for _ in range(self.uv_set))
        return replace(scene, baked_only=self.faces, uv_sets=(*others, uvs))


def udim_tiles(
    make_rasterizer: RasterizerFactory, scene: Scene, polygons: Int64Array, width: int, height: int
) -> tuple[UdimTile, ...]:
    """Return the tiles of the first set of UVs that can hold a bake, by number; none where one texture can hold it.

    polygons        (f,) the polygon of the file that each face is of
    width, height   of the texture of a tile, at which overlaps are found
    """
    needed = needs_uvs(scene)
    if not any(_are_tiles(uvs[needed], _tile_corners(uvs[needed])) for uvs in scene.uv_sets):
        return ()  # without the checks below, which take long
    for uv_set, uvs in enumerate(scene.uv_sets):
        if not check_uvs(make_rasterizer, scene, uv_set, width, height)[0].fault:
            return ()
        corners = _tile_corners(uvs)
        if not _are_tiles(uvs[needed], corners[needed]) or _cut_polygons(corners, polygons, needed):
            continue
        numbers = (_FIRST + corners @ (1, _COLUMNS)).astype(np.int64)
        on_tile = {int(number): numbers == number for number in np.unique(numbers[needed])}
        tiles = [
            UdimTile(number, uv_set, faces & scene.receives, corners[faces][0]) for number, faces in on_tile.items()
        ]
        if not any(check_uvs(make_rasterizer, tile.scene(scene), uv_set, width, height)[0].fault for tile in tiles):
            return tuple(tiles)
    return ()


def _tile_corners(uvs: Float64Array) -> Float64Array:
    """Return the least UVs of the unit square in which the middle of each of (n, 3, 2) faces lies, (n, 2)."""
    corners: Float64Array = np.floor(uvs.mean(axis=1))
    return corners


def _are_tiles(uvs: Float64Array, corners: Float64Array) -> bool:
    """Tell whether each of (n, 3, 2) UVs lies within the tile at its corner, (n, 2), several of those with numbers."""
    inside = uvs - corners[:, None]
    if inside.min() < -_ROUNDING or inside.max() > 1 + _ROUNDING or (corners == corners[0]).all():
        return False
    columns, rows = corners.T
    return bool(corners.min() >= 0 and columns.max() < _COLUMNS and _FIRST + _COLUMNS * rows.max() <= _LAST - _COLUMNS)


def _cut_polygons(corners: Float64Array, polygons: Int64Array, needed: BoolArray) -> bool:
    """Tell whether a polygon has triangles on several tiles, given (f, 2) the corner of the tile of each face."""
    order = np.flatnonzero(needed)[np.argsort(polygons[needed], kind="stable")]
    same = polygons[order[1:]] == polygons[order[:-1]]
    return bool((corners[order[1:]] != corners[order[:-1]])[same].any())
