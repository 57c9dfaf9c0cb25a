"""Instances that share texels, and poses: what moves their samples, and turns their visibility vectors."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.mesh.roles import in_poses
from aoprecalc.mesh.surface import area_vectors, geometric_normals, normalize
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples
from aoprecalc.types import REVERSED_WINDING, BoolArray, Float32Array, Float64Array, Int32Array, Scene
from aoprecalc.visibility.backend import VisibilityTester
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO

MAX_INSTANCES = 8  # instances tested per UV region: 64 axes / 8 = 8 each, one batch of depth maps


@dataclass(frozen=True, eq=False)
class SharedInstances:
    """Instances that share one UV region: each axis is evaluated on one of them.

    faces     (t, f) int32: the face that stands for each face on the t-th instance
    swapped   (t, f) bool: whether that face has its second and third corners the other way round
    parts     (f,) int32: the part of each face
    turns     (t, p, 3, 3) float32: what turns each part onto the t-th instance, v to v @ turn.T; the identity unless
              vectors are wanted
    """

    faces: Int32Array
    swapped: BoolArray
    parts: Int32Array
    turns: Float32Array

    @classmethod
    def from_scene(cls, scene: Scene, *, vectors: bool = False) -> Self:
        """Choose up to MAX_INSTANCES of the instances of each region, at equal intervals if there are more."""
        instances_of_owner: dict[int, list[int]] = {}
        for number, part in enumerate(scene.parts):
            if part.uv_owner is not None:
                instances_of_owner.setdefault(part.uv_owner, [part.uv_owner]).append(number)
        count = min(max(map(len, instances_of_owner.values()), default=1), MAX_INSTANCES)
        faces = np.tile(np.arange(len(scene.faces), dtype=np.int32), (count, 1))
        swapped = np.zeros(faces.shape, bool)
        parts = np.repeat(np.arange(len(scene.parts), dtype=np.int32), [part.stop - part.start for part in scene.parts])
        turns = np.tile(np.eye(3, dtype=np.float32), (count, len(scene.parts), 1, 1))
        for owner, others in instances_of_owner.items():
            own = scene.parts[owner]
            chosen = [others[len(others) * index // count] for index in range(count)] if len(others) > count else others
            for index in range(count):
                other = scene.parts[chosen[index % len(chosen)]]
                faces[index, own.faces] = np.arange(other.start, other.stop)
                swapped[index, own.faces] = (own.vertices != other.vertices).any(axis=1)
                if vectors:
                    corners = scene.corners[own.faces], scene.corners[other.faces]
                    turns[index, owner] = _turn(*corners, swapped[index, own.faces])
        return cls(faces, swapped, parts, turns)

    def accumulate(
        self, tester: VisibilityTester, samples: Samples, axes: Float64Array, group: int, progress: Progress
    ) -> Float32Array:
        """Return the visibility sums of the samples along the (a, 3) axes of a group; see VisibilityTester."""
        count = len(self.faces)
        if count == 1:  # the owners alone
            return tester.accumulate(samples, axes, progress)
        # Every n-th lattice point would not be uniform; a golden-ratio sequence gives each instance a uniform subset.
        instance = ((np.arange(len(axes)) * INV_GOLDEN_RATIO + group * INV_GOLDEN_RATIO**2) % 1.0 * count).astype(int)
        sums: Float32Array = np.zeros(0, np.float32)
        for index in np.unique(instance).tolist():
            added = tester.accumulate(self._on_instance(samples, index), axes[instance == index], progress)
            if added.shape[1] > 2:  # as the owner sees it
                turns = self.turns[index, self.parts[samples.faces]]
                added[:, 2:] = np.einsum("kx,kxy->ky", added[:, 2:], turns)
            sums = added if not len(sums) else sums + added
        return sums

    def _on_instance(self, samples: Samples, index: int) -> Samples:
        """Move the samples to the same points of another instance."""
        has_face = samples.faces >= 0
        swapped = has_face & self.swapped[index][samples.faces]
        weights = np.where(swapped[:, None], samples.weights[:, REVERSED_WINDING], samples.weights)
        return Samples(np.where(has_face, self.faces[index][samples.faces], np.int32(-1)), weights)


def mean_over_poses(sums: Iterable[Float32Array]) -> Float32Array:
    """Return the mean of the visibility sums in all poses: the quotient of its columns is that of their totals."""
    each = iter(sums)
    total, count = next(each), 1
    for own in each:
        total, count = total + own, count + 1
    return total / np.float32(count)


def turns_to_rest(scene: Scene, normals: Float32Array) -> Float32Array:
    """Return what turns each face of a scene from each of its p poses to the rest pose, (p, f, 3, 3): v to v @ turn.

    normals   (f, 3, 3): the shading normals in the rest pose
    A pose that mirrors is turned by a reflection.
    """

    def frames(stands: Scene, shading: Float32Array) -> Float64Array:
        along, across = normalize(stands.corners[:, 1:] - stands.corners[:, :1]).transpose(1, 0, 2)
        across = normalize(across - np.einsum("fx,fx->f", along, across)[:, None] * along)
        return np.stack([along, across, geometric_normals(stands, shading)], axis=1)

    rest = frames(scene, normals)
    turns = [np.einsum("fkx,fky->fxy", frames(*pose), rest) for pose in in_poses(scene, normals)]
    return np.stack(turns).astype(np.float32)


def _turn(own: Float64Array, other: Float64Array, swapped: BoolArray) -> Float64Array:
    """Return the rotation or reflection, (3, 3), that comes nearest to what moves the faces of a part to its instance.

    own, other   (n, 3, 3): the corners of both; of faces that are swapped the second and third of the other are so
    The normals count too: a flat part has no thickness that would tell its sides apart.
    (P. Schönemann, "A generalized solution of the orthogonal Procrustes problem", 1966.)
    """
    normals = [normalize(area_vectors(corners)) for corners in (own, other)]
    ordered = own, np.where(swapped[:, None, None], other[:, REVERSED_WINDING], other)
    offsets = [corners.reshape(-1, 3) - corners.mean(axis=(0, 1)) for corners in ordered]
    first, second = (np.concatenate([to / np.linalg.norm(to), n]) for to, n in zip(offsets, normals, strict=True))
    after, _, before = np.linalg.svd(second.T @ first)
    turn: Float64Array = after @ before
    return turn
