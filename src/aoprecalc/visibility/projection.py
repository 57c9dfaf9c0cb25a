"""From points of a simple mesh to points of a detailed one: rays from a cage around the first meet the second.

Let q be the point of the cage, and d the direction, that belong to a point p of the low surface; q = p + c d. The ray
goes from q along -d, and ends 2 c away, as far behind p as it began before it. The point of p on the high surface is
where the ray first meets a face of its partners whose front it sees. The holes of alpha masks let it through.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.detail import Detail
from aoprecalc.mesh.masked_triangles import MaskedTriangles
from aoprecalc.mesh.surface import SurfacePoints, bounding_sphere, geometric_normals, normalize
from aoprecalc.raster.layout import Samples
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene
from aoprecalc.visibility.rays import RayCaster

_CHUNK = 1 << 18  # points projected at a time: bounds memory
_STEP = 1e-6  # over the bounding radius: from a face that does not count to where the ray begins anew
_MAX_LAYERS = 256  # of faces that do not count, behind each other


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays meet a surface.

    rays        (k,) which of the rays
    faces       (k,) int32 into the high scene
    weights     (k, 3) float32 barycentric
    distances   (k,) float64 along the rays, in normalized units
    """

    rays: NDArray[np.intp]
    faces: Int32Array
    weights: Float32Array
    distances: Float64Array

    @classmethod
    def joined(cls, several: list["Hits"]) -> "Hits":
        """Return several of them, perhaps none, as one."""
        none = cls(np.zeros(0, np.intp), np.zeros(0, np.int32), np.zeros((0, 3), np.float32), np.zeros(0))
        arrays = ([getattr(hits, entry.name) for hits in (none, *several)] for entry in fields(cls))
        return cls(*map(np.concatenate, arrays))


class Projection:
    """Projects points of a low scene onto the high one of a Detail. Positions are normalized to about 1."""

    def __init__(self, low: Scene, detail: Detail, threads: int = 0) -> None:
        """Build the high parts that each low part may meet. Raises RendererError where embreex is missing."""
        high = detail.scene
        center, radius = bounding_sphere(high.positions)
        self.unit = radius
        self.low_corners: Float64Array = (low.corners - center) / radius
        self.high_normals = geometric_normals(high, detail.normals)
        self._directions, self._distances = detail.cage.directions, detail.cage.distances / radius
        self._both_sides = high.two_sided
        self._masked = MaskedTriangles.from_scene(high)
        self._roots = None if self._masked is None else self._masked.roots_of_faces(len(high.faces))
        corners = ((high.corners - center) / radius).astype(np.float32)
        numbers = {partners: number for number, partners in enumerate(dict.fromkeys(detail.partners))}
        sizes = [part.stop - part.start for part in low.parts]
        self._target_of_face = np.repeat([numbers[partners] for partners in detail.partners], sizes)
        self._targets = []
        for partners in numbers:
            faces = np.concatenate([np.arange(high.parts[part].start, high.parts[part].stop) for part in partners])
            self._targets.append((RayCaster(corners[faces], threads), faces.astype(np.int32)))

    def samples(self, samples: Samples) -> Samples:
        """Return the samples on the high surface that belong to samples of the low one; no face where there is none."""
        faces = np.full(len(samples.faces), -1, np.int32)
        weights = np.tile(np.array((1, 0, 0), np.float32), (len(faces), 1))
        chosen = np.flatnonzero(samples.faces >= 0)
        for start in range(0, len(chosen), _CHUNK):
            part = chosen[start : start + _CHUNK]
            found = self._first_facing(samples.faces[part], samples.weights[part].astype(np.float64))
            faces[part[found.rays]], weights[part[found.rays]] = found.faces, found.weights
        return Samples(faces, weights)

    def points(self, points: SurfacePoints) -> tuple[BoolArray, SurfacePoints]:
        """Return which of k points of the low surface have one on the high surface, (k,) bool, and these points."""
        found = self.samples(Samples(points.faces.astype(np.int32), points.weights.astype(np.float32)))
        hit = found.faces >= 0
        weights = found.weights[hit].astype(np.float64)
        return hit, SurfacePoints(found.faces[hit].astype(np.intp), weights / weights.sum(axis=1, keepdims=True))

    def lines(self, faces: NDArray[np.integer], weights: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return k points of the low surface and their directions towards the cage, (k, 3) each."""
        positions = np.einsum("kc,kcx->kx", weights, self.low_corners[faces])
        return positions, normalize(np.einsum("kc,kcx->kx", weights, self._directions[faces]))

    def layers(
        self,
        low_faces: NDArray[np.integer],
        origins: Float64Array,
        directions: Float64Array,
        lengths: Float64Array,
        *,
        fronts: bool,
    ) -> Iterator[Hits]:
        """Yield what k rays meet: the first face of each, then the second, and so on, as long as the rays last.

        A ray also ends where its length is set to 0 meanwhile.

        low_faces   (k,) where the rays come from: they meet the partners of its part
        fronts      only faces of which a ray sees the front; else only those of which it sees the back
        """
        waiting, done = np.flatnonzero(directions.any(axis=1)), np.zeros(len(origins))
        targets, along = self._target_of_face[low_faces], directions.astype(np.float32)
        for _ in range(_MAX_LAYERS):
            hits = self._meet(waiting, targets, origins, along, lengths, done)
            waiting = hits.rays
            if not len(waiting):
                return
            done[waiting] = hits.distances + _STEP
            cosines = np.einsum("kx,kx->k", self.high_normals[hits.faces], directions[waiting])
            counts = (cosines < 0 if fronts else cosines > 0) | self._both_sides[hits.faces]
            counts &= ~self._in_holes(hits)
            yield Hits(waiting[counts], hits.faces[counts], hits.weights[counts], hits.distances[counts])

    def _in_holes(self, hits: Hits) -> BoolArray:
        """Return which of k hits are in the hole of an alpha mask, (k,) bool."""
        holes: BoolArray = np.zeros(len(hits.faces), bool)
        if self._masked is not None and self._roots is not None:
            roots = self._roots[hits.faces]
            masked = roots >= 0
            weights = hits.weights[masked, 1:].astype(np.float64)
            holes[masked] = self._masked.excess(roots[masked], weights) < 0
        return holes

    def _meet(
        self,
        waiting: NDArray[np.intp],
        targets: NDArray[np.intp],
        origins: Float64Array,
        along: Float32Array,
        lengths: Float64Array,
        done: Float64Array,
    ) -> Hits:
        """Return what some of the rays meet first beyond the part of their length that is done."""
        met = list[Hits]()
        for number, (caster, faces) in enumerate(self._targets):
            rays = waiting[targets[waiting] == number]
            left = (lengths[rays] - done[rays]).astype(np.float32)
            rays, left = rays[left > 0], left[left > 0]
            starts = (origins[rays] + done[rays, None] * along[rays]).astype(np.float32)
            triangles, distances, weights = caster.meets(starts, along[rays], left)
            hit = triangles >= 0
            rays = rays[hit]
            met.append(Hits(rays, faces[triangles[hit]], weights[hit], done[rays] + distances[hit]))
        return Hits.joined(met)

    def _first_facing(self, faces: Int32Array, weights: Float64Array) -> Hits:
        """Return where k points of the low surface are on the high one."""
        positions, directions = self.lines(faces, weights)
        distances = np.einsum("kc,kc->k", weights, self._distances[faces])
        origins = positions + distances[:, None] * directions
        found = np.zeros(len(faces), bool)
        first = list[Hits]()
        lengths = 2 * distances
        for hits in self.layers(faces, origins, -directions, lengths, fronts=True):
            first.append(hits)
            found[hits.rays] = True
            lengths[hits.rays] = 0  # these are done
            if found.all():
                break
        return Hits.joined(first)
