"""The cage around a low mesh: at a distance, from a file, or as far away as the detailed surface needs (auto).

Auto looks at points of the low surface. From each, rays go both ways along the direction towards the cage and meet the
fronts of the high surface. What they meet at a distance t belongs to another part of the low surface where that is
nearer to it than t / 2. So each point tells

    need    how far out the farthest of its own high surface is, or how far in, where there is none outside
    limit   how far out the first of another part's is

and each vertex has the greatest need of the faces around it with a margin, or stays within their least limit where
more of the points would meet another part than miss their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aoprecalc.errors import InputError, counted
from aoprecalc.mesh.detail import Cage, Detail, cage_of
from aoprecalc.mesh.surface import SurfacePoints, area_vectors, normalize, receiving_diagonal, sample_surface
from aoprecalc.types import Float64Array, Int32Array, Scene
from aoprecalc.visibility.projection import Projection

_POINTS = 1 << 16  # uniform on the low surface, besides the middle and three more of each face
_REACH = 0.25  # of the diagonal: how far rays go
_MARGIN = 1.25  # over the greatest need that was found: the surface may reach farther between the points
_LEAST = 2e-3  # of the diagonal
_OWN = 0.5  # share of its distance along the ray that a point of the high surface has from the low one, at least
_WITHIN = 0.9  # of the limit
_NEIGHBOURS = 8  # points among whose faces the nearest is looked for
_START = 1e-5  # over the bounding radius: how far behind a point a ray begins, so that it meets what touches the point
_FAR = 0.25  # of the diagonal: a file whose faces are mostly farther away is no cage of this mesh


def read_cage(low: Scene, cage: Scene) -> Cage:
    """Return the cage that a file holds; raises InputError where it is not one of the low mesh."""
    if len(cage.faces) != len(low.faces):
        found, expected = counted(len(cage.faces), "face"), counted(len(low.faces), "face")
        raise InputError(
            f"{cage.path}: has {found}, a cage of {low.path} has {expected}, each where its face is or before it; "
            "make it of a copy of that mesh by moving its vertices, or use --cage auto"
        )
    found_cage = cage_of(low, cage)
    if np.median(found_cage.distances[low.receives]) > _FAR * receiving_diagonal(low):
        raise InputError(
            f"{cage.path}: its faces are far from those of {low.path}, which they should enclose; export both with "
            "their faces in the same order, or use --cage auto"
        )
    return found_cage


def auto_cage(low: Scene, detail: Detail, threads: int = 0) -> Cage:
    """Return a cage that encloses the high surface, and no other part of it: see above.

    detail   whose cage does not count
    """
    largest = receiving_diagonal(low)
    probes = _probe(low, detail, largest, threads)
    vertices = low.faces[probes.faces]
    need, limit = np.full(len(low.positions), -1.0), np.full(len(low.positions), np.inf)
    np.maximum.at(need, vertices, probes.needs[:, None])
    np.minimum.at(limit, vertices, probes.limits[:, None])
    known = need >= 0
    need[~known] = np.median(need[known]) if known.any() else 0.0
    wide = np.maximum(_MARGIN * need, _LEAST * largest)
    narrow = np.minimum(wide, _WITHIN * limit)
    missed, wrong = np.zeros((2, len(low.positions)), np.intp)
    np.add.at(missed, vertices, probes.needs[:, None] > narrow[vertices])
    np.add.at(wrong, vertices, probes.limits[:, None] < wide[vertices])
    return Cage(detail.cage.directions, np.where(wrong > missed, narrow, wide)[low.faces])


@dataclass(frozen=True, eq=False)
class _Probes:
    """What k points of the low surface tell, in the units of the mesh.

    faces    (k,) that the points lie on
    needs    (k,) -1 where the point found nothing of its own
    limits   (k,) infinite where nothing of another part is in the way
    """

    faces: NDArray[np.integer]
    needs: Float64Array
    limits: Float64Array


def _probe(low: Scene, detail: Detail, largest: float, threads: int) -> _Probes:
    points = _points(low)
    projection = Projection(low, detail, threads)
    surface = _LowSurface(low, projection.low_corners, points, threads)
    positions, directions = projection.lines(points.faces, points.weights)
    reach = np.full(len(positions), _REACH * largest / projection.unit)
    needs, limits = np.full(len(positions), -1.0), np.full(len(positions), np.inf)

    def is_own(rays: NDArray[np.intp], faces: Int32Array, distances: Float64Array, sign: float) -> NDArray[np.bool_]:
        places = positions[rays] + sign * distances[:, None] * directions[rays]
        nearness = surface.distance(places, projection.high_normals[faces])
        own: NDArray[np.bool_] = nearness >= _OWN * distances - _START
        return own

    for sign in (1.0, -1.0):
        open_ones = np.ones(len(positions), bool) if sign > 0 else needs < 0
        lengths = np.where(open_ones, reach, 0.0)
        origins = positions - sign * _START * directions
        for hits in projection.layers(points.faces, origins, sign * directions, lengths, fronts=sign < 0):
            distances = np.maximum(hits.distances - _START, 0)
            own = is_own(hits.rays, hits.faces, distances, sign)
            needs[hits.rays[own]] = distances[own]  # outwards the last one stays
            if sign > 0:
                limits[hits.rays[~own]] = distances[~own]
                lengths[hits.rays[~own]] = 0
            else:
                lengths[hits.rays] = 0
    return _Probes(points.faces, np.where(needs < 0, -1.0, needs * projection.unit), limits * projection.unit)


def _points(low: Scene) -> SurfacePoints:
    """Return points uniform on the receiving surface, and four of each face of it."""
    uniform = sample_surface(low, low.receives, _POINTS, seed=0)
    own = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4)], float)
    own /= own.sum(axis=1, keepdims=True)
    faces = np.flatnonzero(low.receives)
    return SurfacePoints(
        np.concatenate([uniform.faces, np.repeat(faces, len(own))]),
        np.concatenate([uniform.weights, np.tile(own, (len(faces), 1))]),
    )


class _LowSurface:
    """Tells how far points are from the low surface, of which some points are known."""

    def __init__(self, low: Scene, corners: Float64Array, points: SurfacePoints, threads: int) -> None:
        self._threads = threads or -1  # of SciPy: all
        self._corners, self._faces = corners, points.faces
        self._normals = normalize(area_vectors(corners))
        self._tree = cKDTree(points.interpolate(corners))

    def distance(self, places: Float64Array, normals: NDArray[np.floating]) -> Float64Array:
        """Return the distance of k places from the faces near them that face as their normals do; infinite for none."""
        nearest = self._tree.query(places, _NEIGHBOURS, workers=self._threads)[1].T
        distances = np.full(len(places), np.inf)
        for points in nearest:
            faces = self._faces[points]
            agree = np.einsum("kx,kx->k", self._normals[faces], normals) > 0
            found = _distances_to_triangles(places, self._corners[faces])
            distances = np.where(agree, np.minimum(distances, found), distances)
        return distances


def _distances_to_triangles(places: Float64Array, corners: Float64Array) -> Float64Array:
    """Return the distance of each of k places to its triangle, (k, 3, 3), which is its plane's where it is over it."""
    normals = normalize(area_vectors(corners))
    to_edges, inside = np.full(len(places), np.inf), normals.any(axis=1)
    for corner in range(3):
        start, edge = corners[:, corner], corners[:, (corner + 1) % 3] - corners[:, corner]
        offset = places - start
        share = np.einsum("kx,kx->k", offset, edge) / np.maximum(np.einsum("kx,kx->k", edge, edge), 1e-300)
        to_edges = np.minimum(to_edges, np.linalg.norm(offset - share.clip(0, 1)[:, None] * edge, axis=1))
        inside &= np.einsum("kx,kx->k", np.cross(normals, edge), offset) >= 0
    height = np.abs(np.einsum("kx,kx->k", normals, places - corners[:, 0]))
    return np.where(inside, height, to_edges)
