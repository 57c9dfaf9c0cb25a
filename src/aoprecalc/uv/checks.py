"""The UVs of a texture: which faces need them, whether the file's can hold a bake, how dense their texels are."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self
from weakref import WeakKeyDictionary

import numpy as np

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.mesh.surface import area_vectors, face_normals
from aoprecalc.mesh.topology import face_components
from aoprecalc.raster.layout import (
    MAX_TILES,
    Layout,
    Rasterizer,
    atlas_from_uvs,
    build_layout,
    corner_ids,
    doubled_uv_areas,
)
from aoprecalc.types import Atlas, BoolArray, Scene, UvCheck

RasterizerFactory = Callable[[Layout], Rasterizer]

# The faces with area, (f,) bool, of scenes in use: they are asked for at every step of a bake.
_WITH_AREA: WeakKeyDictionary[Scene, BoolArray] = WeakKeyDictionary()

MAX_OVERLAP = 0.001  # share of the covered texels inside two triangles, and of the surface without area in UV space


def check_uvs(
    make_rasterizer: RasterizerFactory, scene: Scene, uv_set: int, width: int, height: int
) -> tuple[UvCheck, Atlas | None]:
    """Check one of the file's UV sets, by index; also return its atlas, None where it has no area or repeats too much.

    It has no fault if the faces without area in UV space, by their share of the surface, and the texels that lie inside
    two triangles, wrapped modulo 1, by theirs of the covered ones, are less than MAX_OVERLAP together, and no face
    spans more than MAX_TILES repeats of the texture. Faces without area in UV space have no place in the atlas.
    """
    uvs, needed = scene.uv_sets[uv_set], needs_uvs(scene)
    longest = np.linalg.norm(np.roll(uvs, -1, axis=1) - uvs, axis=2).max(axis=1)
    without = needed & (doubled_uv_areas(uvs) <= 1e-9 * np.maximum(longest**2, 1e-9))
    mapped, flat, share = needed & ~without, int(np.count_nonzero(without)), surface_share(scene, without)
    no_area = f"{counted(flat, 'face')} with area {one_or_many(flat, 'has', 'have')} no area in UV space"
    check = UvCheck(uv_set, flat, share, 0, None, f"{no_area} ({share:.1%} of the surface)" if flat else "")
    if not mapped.any():
        return check, None
    check = replace(check, tiles=int(np.ceil(uvs[mapped].max(axis=1) - np.floor(uvs[mapped].min(axis=1))).max()))
    if check.tiles > MAX_TILES:
        fault = f"a face lies on {check.tiles} repeats of the texture; at most {MAX_TILES} may be"
        return replace(check, fault=fault), None
    atlas = replace(atlas_from_uvs(scene, uvs, mapped), uv_set=uv_set)
    overlap = make_rasterizer(build_layout(scene, atlas, width, height)).overlap()
    if share + overlap < MAX_OVERLAP:
        fault = ""
    elif overlap >= MAX_OVERLAP:
        fault = f"{overlap:.1%} of the texels lie inside two triangles; at most {MAX_OVERLAP:.1%} may"
    else:
        fault = check.fault
    return replace(check, overlap=overlap, fault=fault), atlas


def surface_share(scene: Scene, faces: BoolArray) -> float:
    """Return the share of the surface that needs UVs which some of its faces, (f,) bool, are."""
    if not faces.any():
        return 0.0
    areas = np.linalg.norm(area_vectors(scene.corners), axis=1)
    return float(areas[faces].sum() / areas[needs_uvs(scene)].sum())


def needs_uvs(scene: Scene) -> BoolArray:
    """Return the faces, (f,) bool, that need UVs of their own: those with area that receive and share no other's UVs.

    Raises InputError where there are none.
    """
    baked = scene.receives & scene.per_face(part.uv_owner is None for part in scene.parts)
    if scene not in _WITH_AREA:
        _WITH_AREA[scene] = face_normals(scene.corners)[1]
    with_area: BoolArray = baked & _WITH_AREA[scene]
    if not with_area.any():
        raise InputError(
            f"{scene.path}: none of {counted(np.count_nonzero(baked), 'face')} has area; expected a surface to bake"
        )
    return with_area


@dataclass(frozen=True)
class TexelDensity:
    """Texels per unit of length on the surface: the root of a texture area, in texels, over the surface's there.

    mean    of all that has texels
    least   of the chart that has the fewest
    """

    mean: float
    least: float

    @classmethod
    def of(cls, scene: Scene, atlas: Atlas, width: int, height: int) -> Self:
        """Measure an atlas in a texture of this size."""
        mapped = atlas.mapped
        chart = face_components(corner_ids(scene.faces[mapped], atlas.uvs[mapped]))
        texels = np.bincount(chart, doubled_uv_areas(atlas.uvs[mapped])) * width * height
        surface = np.bincount(chart, np.linalg.norm(area_vectors(scene.corners[mapped]), axis=1))
        return cls(float(np.sqrt(texels.sum() / surface.sum())), float(np.sqrt((texels / surface).min())))
