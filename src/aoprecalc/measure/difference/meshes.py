"""How far apart two meshes with ambient occlusion are."""

from dataclasses import dataclass

import numpy as np

from aoprecalc.measure.difference.difference import Difference, diagonal, figure, shrunk, unlike
from aoprecalc.measure.difference.pictures import picture_difference
from aoprecalc.model import Doubles, Floats


@dataclass(frozen=True, eq=False)
class Surface:
    """What is compared of a mesh.

    corners       (f, 3, 3) float64, finite, f >= 1: the positions of each face's corners
    normals       (f, 3, 3) float32, unit length, at the corners; None where the file has none
    uv_sets       those of the file, each (f, 3, 2) float64
    picture       (h, w, 1) float32, finite: the ambient occlusion; None where there is none
    picture_uvs   (f, 3, 2) float64: how it lies on the mesh, one of the sets or made from it; NaN where it does not
    """

    corners: Doubles
    normals: Floats | None
    uv_sets: tuple[Doubles, ...]
    picture: Floats | None = None
    picture_uvs: Doubles | None = None


def mesh_difference(first: Surface, second: Surface) -> Difference:
    """Compare meshes corner by corner, in the order in which their files have them, and their pictures.

    The value is the greatest of: how far a position has moved, over the diagonal of the box around both meshes; how far
    a UV has moved; the length of the difference of two normals; the pictures' root mean square.
    """
    pictures = None
    if first.picture is not None and second.picture is not None:
        pictures = picture_difference(first.picture, second.picture)
    pair = None if pictures is None else pictures.pair
    reason = _unlike(first, second) or ("" if pictures is None else pictures.reason)
    if reason:
        return unlike(reason, pair)
    corners = shrunk(first.corners, second.corners)
    moved = _farthest(*corners) / diagonal(np.stack(corners))
    uvs = [_farthest(*sets) for sets in zip(first.uv_sets, second.uv_sets, strict=True)]
    if first.picture_uvs is not None and second.picture_uvs is not None:
        uvs.append(_farthest(first.picture_uvs, second.picture_uvs))
    normals = None
    if first.normals is not None and second.normals is not None:
        normals = _farthest(first.normals, second.normals)
    value = max(moved, *uvs, normals or 0.0, 0.0 if pictures is None else pictures.value or 0.0)
    details = {
        "triangles": len(first.corners),
        "position": figure(moved),
        "uv": figure(max(uvs)) if uvs else None,
        "normal": None if normals is None else figure(normals),
        "texture": None if pictures is None else pictures.details,
    }
    return Difference(value, equal=value == 0, details=details, pair=pair)


def _unlike(first: Surface, second: Surface) -> str:
    """Say why the meshes cannot be laid on one another; nothing where they can."""
    if len(first.corners) != len(second.corners):
        return f"they have {len(first.corners)} and {len(second.corners)} triangles"
    for name, has in {
        "a picture of ambient occlusion": [surface.picture is not None for surface in (first, second)],
        "normals": [surface.normals is not None for surface in (first, second)],
    }.items():
        if has[0] != has[1]:
            return f"only {'A' if has[0] else 'B'} has {name}"
    if len(first.uv_sets) != len(second.uv_sets):
        return f"they have {len(first.uv_sets)} and {len(second.uv_sets)} sets of UVs"
    if first.picture_uvs is not None and second.picture_uvs is not None:
        places = [~np.isnan(surface).any(axis=(1, 2)) for surface in (first.picture_uvs, second.picture_uvs)]
        if (places[0] != places[1]).any():
            return f"their pictures lie on {places[0].sum()} and {places[1].sum()} triangles, not all of them the same"
    return ""


def _farthest(first: Doubles | Floats, second: Doubles | Floats) -> float:
    """Return the greatest distance between two arrays' points, (..., d); places without a point count as 0."""
    with np.errstate(over="ignore"):  # UVs may be of any size
        away = np.linalg.norm(second.astype(np.float64) - first, axis=-1)
    return float(np.nan_to_num(away, nan=0.0).max())
