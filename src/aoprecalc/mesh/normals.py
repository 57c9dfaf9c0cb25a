"""Geometric normals of faces, and shading normals at their corners where the file has none."""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.mesh.topology import edge_ids
from aoprecalc.options import Normals
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene

_SMOOTH_ANGLE = 180.0  # degrees: no edge is hard
_STL_ANGLE = 40.0  # STL stores no smooth normals: sharper edges were probably meant to be hard
# Twice the area of a face over its longest edge squared, below which doubles cannot tell its direction.
_MIN_FLATNESS = 1e-12
_ZERO, _Z_AXIS = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def normalize(vectors: NDArray[np.floating]) -> Float64Array:
    """Divide (..., 3) vectors by their lengths; zero vectors stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Float64Array = vectors / np.where(lengths > 0, lengths, 1)
    return units


def area_vectors(corners: Float64Array) -> Float64Array:
    """Return twice the area of each face times its unit normal, (f, 3), from (f, 3, 3) corners; follows the winding."""
    vectors: Float64Array = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return vectors


def face_normals(corners: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Return (f, 3) unit normals that follow the winding, and which faces have area, (f,) bool, from (f, 3, 3) corners.

    The normal of a face without area is (0, 0, 1). Only the shape of a face matters, not its scale.
    """
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1, keepdims=True)
    sides = sides / np.where(longest > 0, longest, 1)[:, :, None]
    normals = np.cross(sides[:, 0], sides[:, 1])
    has_area: BoolArray = np.linalg.norm(normals, axis=1) > _MIN_FLATNESS
    return np.where(has_area[:, None], normalize(normals), _Z_AXIS), has_area


def default_crease_angle(scene: Scene) -> float:
    """Return the dihedral angle in degrees beyond which edges are hard, unless the user says another."""
    return _STL_ANGLE if scene.format == "stl" else _SMOOTH_ANGLE


def shading_normals(scene: Scene, mode: Normals = "auto", crease_angle: float | None = None) -> Float32Array:
    """Return unit shading normals at the corners, (f, 3, 3) float32.

    mode          auto: the file's, else smooth; file: the file's; flat: the face normal; smooth: the area-weighted mean
                  of the faces around a position, split at edges whose dihedral angle exceeds `crease_angle`
    crease_angle  degrees in [0, 180]; None: 180, and 40 for STL
    Raises InputError for mode file where the file has no normals.
    """
    if mode == "file" and scene.normals is None:
        raise InputError(f"{scene.path}: has no normals, which --normals file asks for; use --normals auto or smooth")
    if mode in ("auto", "file") and scene.normals is not None:
        return scene.normals
    areas = area_vectors(scene.corners)
    flat = np.repeat(_unit(areas)[:, None], 3, axis=1)
    if mode == "flat":
        return flat.astype(np.float32)
    angle = default_crease_angle(scene) if crease_angle is None else crease_angle
    groups = scene.faces if angle >= _SMOOTH_ANGLE else _smooth_groups(scene.faces, _unit(areas, empty=_ZERO), angle)
    of_corner = groups.ravel()
    sums: Float64Array = np.column_stack([np.bincount(of_corner, np.repeat(areas[:, axis], 3)) for axis in range(3)])
    # Where opposite faces cancel there is no mean: their corners keep the face normal.
    total_area = np.bincount(of_corner, np.repeat(np.linalg.norm(areas, axis=1), 3))
    cancelled = np.linalg.norm(sums, axis=1) <= 1e-9 * total_area
    smooth = np.where(cancelled[groups][..., None], flat, _unit(sums)[groups])
    return smooth.astype(np.float32)


def geometric_normals(scene: Scene, shading: Float32Array) -> Float32Array:
    """Return the unit normal of each face, (f, 3) float32, zero for faces without area.

    It follows the winding, but is flipped where the shading normals at all three corners oppose it.
    """
    normals = _unit(area_vectors(scene.corners), empty=_ZERO)
    opposed = (np.einsum("fcx,fx->fc", shading, normals) < 0).all(axis=1)
    return np.where(opposed[:, None], -normals, normals).astype(np.float32)


def _smooth_groups(faces: Int32Array, normals: Float64Array, angle: float) -> Int32Array:
    """Label corners, (f, 3): equal where faces around a position are joined by edges that bend at most `angle`."""
    ids = edge_ids(faces).ravel()
    order = np.argsort(ids, kind="stable")
    first, second = order[:-1], order[1:]
    # Consecutive pairs are enough to connect all faces of an edge that more than two share.
    shared = ids[first] == ids[second]
    first, second = first[shared], second[shared]
    cosine = np.einsum("ex,ex->e", normals[first // 3], normals[second // 3])
    # A face without area has no direction to bend from: its neighbours are joined through it.
    no_area: BoolArray = np.linalg.norm(normals, axis=1) == 0
    gentle = (cosine >= np.cos(np.radians(angle)) - 1e-9) | no_area[first // 3] | no_area[second // 3]
    first, second = first[gentle], second[gentle]
    joined_from, joined_to = [], []
    for end in (0, 1):
        corner = first // 3 * 3 + (first % 3 + end) % 3
        for other_end in (0, 1):
            other = second // 3 * 3 + (second % 3 + other_end) % 3
            same = faces.ravel()[corner] == faces.ravel()[other]
            joined_from.append(corner[same])
            joined_to.append(other[same])
    rows, columns = np.concatenate(joined_from), np.concatenate(joined_to)
    from scipy.sparse import coo_array  # in functions: its import takes as long as a small preview
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(faces.size, faces.size))
    labels: Int32Array = connected_components(graph, directed=False)[1].astype(np.int32)
    return labels.reshape(faces.shape)


def _unit(vectors: Float64Array, empty: tuple[float, float, float] = _Z_AXIS) -> Float64Array:
    """Normalize (m, 3) vectors of any scale; zero vectors become `empty`."""
    # Scaled first: the squared length of a tiny vector would underflow.
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    return np.where(largest > 0, normalize(vectors / np.where(largest > 0, largest, 1.0)), empty)
