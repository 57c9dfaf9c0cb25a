"""Tangents at the corners of triangles, as MikkTSpace defines them: the bases that normal maps are made for.

(M. S. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008, and its reference code.) Blender, Unity, Unreal and
glTF viewers agree on it. Corners are one vertex where position, normal and UVs are equal. Faces around a vertex that
are joined by edges, and in which the UVs run the same way round, share a tangent: the mean of theirs, each projected
into the plane of the normal, by their angles. Faces without area in the UVs take that of a neighbour.
"""

import numpy as np

from aoprecalc.mesh.surface import normalize
from aoprecalc.mesh.topology import adjacent_half_edges, corner_groups, unique_rows
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array


def corner_tangents(corners: Float64Array, normals: Float32Array, uvs: Float64Array) -> Float32Array:
    """Return tangents, (f, 3, 4) float32: a unit vector along u, and the sign s of the bitangent s * cross(n, t).

    corners   (f, 3, 3) positions; normals: (f, 3, 3) of unit length; uvs: (f, 3, 2), v upwards
    """
    count = len(corners)
    rows = [values.reshape(3 * count, -1) for values in (corners, normals.astype(np.float64), uvs)]
    vertices = unique_rows(*(column for values in rows for column in values.T))[1].reshape(-1, 3).astype(np.int32)
    sides, steps = corners[:, 1:] - corners[:, :1], uvs[:, 1:] - uvs[:, :1]
    area = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]
    sign = np.where(area > 0, 1.0, -1.0)
    along = (steps[:, 1, 1, None] * sides[:, 0] - steps[:, 0, 1, None] * sides[:, 1]) * sign[:, None]
    used = (np.abs(area) > np.finfo(np.float32).tiny) & (np.linalg.norm(along, axis=1) > 0)
    groups = _groups(vertices, sign, used)
    projected = normalize(_in_plane(normalize(along)[:, None], normals))
    sums = np.zeros((groups.max() + 1, 3))
    np.add.at(sums, groups[used], (projected * _angles(corners, normals)[..., None])[used])
    tangents = normalize(sums)[groups]
    signs = np.broadcast_to(sign[:, None], groups.shape).copy()
    _take_from_neighbours(vertices, used, tangents, signs)
    missing = ~tangents.any(axis=2)
    tangents[missing] = _any_tangent(normals[missing])
    return np.concatenate([tangents, signs[..., None]], axis=2).astype(np.float32)


def _groups(vertices: Int32Array, sign: Float64Array, used: BoolArray) -> Int32Array:
    """Label corners, (f, 3): equal where faces around a vertex are joined by edges, with UVs of the same sign."""
    first, second = adjacent_half_edges(vertices)
    joined = used[first // 3] & used[second // 3] & (sign[first // 3] == sign[second // 3])
    return corner_groups(vertices, first[joined], second[joined])


def _in_plane(vectors: Float64Array, normals: Float32Array) -> Float64Array:
    """Return vectors without their part along the normals."""
    part = np.einsum("fcx,fcx->fc", np.broadcast_to(vectors, normals.shape), normals)
    flat: Float64Array = vectors - part[..., None] * normals
    return flat


def _angles(corners: Float64Array, normals: Float32Array) -> Float64Array:
    """Return the angle of each face at its corners, (f, 3), between its sides in the plane of the normal."""
    ahead, back = (normalize(_in_plane(np.roll(corners, turn, axis=1) - corners, normals)) for turn in (-1, 1))
    cosines: Float64Array = np.einsum("fcx,fcx->fc", ahead, back)
    return np.arccos(np.clip(cosines, -1.0, 1.0))


def _take_from_neighbours(
    vertices: Int32Array,
    used: BoolArray,
    tangents: Float64Array,
    signs: Float64Array,
) -> None:
    """Give the corners of faces without area in the UVs the tangents that others have at their vertices, if any."""
    known, index = np.unique(vertices[used], return_index=True)
    place = np.clip(np.searchsorted(known, vertices), 0, max(len(known) - 1, 0))
    if len(known):
        found = ~used[:, None] & (known[place] == vertices)
        tangents[found] = tangents[used].reshape(-1, 3)[index[place[found]]]
        signs[found] = signs[used].reshape(-1)[index[place[found]]]


def _any_tangent(normals: Float32Array) -> Float64Array:
    """Return unit vectors at right angles to (k, 3) normals."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return normalize(np.cross(np.cross(normals, least), normals))
