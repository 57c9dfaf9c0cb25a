"""Instances that have one place in the texture together take turns at it: each looks along some of the axes."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.progress import Progress
from aoprecalc.raster.samples import Samples
from aoprecalc.types import REVERSED_WINDING, BoolArray, Float32Array, Float64Array, Int32Array, Scene
from aoprecalc.visibility.backend import VisibilityTester
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO

MAX_INSTANCES = 8  # of a group's 64 axes each has eight then, as many as a batch of maps


@dataclass(frozen=True, eq=False)
class SharedInstances:
    """Whose turn it is.

    faces     (t, f) int32: the face from which a sample on each face looks at each turn
    swapped   (t, f) bool: that face has its second and third corners the other way round
    """

    faces: Int32Array
    swapped: BoolArray

    @classmethod
    def from_scene(cls, scene: Scene) -> Self:
        """Let up to MAX_INSTANCES sharers of a place take turns, evenly chosen where they are more."""
        sharers: dict[int, list[int]] = {}
        for number, part in enumerate(scene.parts):
            if part.uv_owner is not None:
                sharers.setdefault(part.uv_owner, [part.uv_owner]).append(number)
        turns = min(max(map(len, sharers.values()), default=1), MAX_INSTANCES)
        faces = np.tile(np.arange(len(scene.faces), dtype=np.int32), (turns, 1))
        swapped = np.zeros(faces.shape, bool)
        for owner, those in sharers.items():
            own = scene.parts[owner]
            chosen = [those[len(those) * turn // turns] for turn in range(turns)] if len(those) > turns else those
            for turn in range(turns):
                other = scene.parts[chosen[turn % len(chosen)]]
                faces[turn, own.faces] = np.arange(other.start, other.stop)
                swapped[turn, own.faces] = (own.vertices != other.vertices).any(axis=1)
        return cls(faces, swapped)

    def accumulate(
        self, tester: VisibilityTester, samples: Samples, axes: Float64Array, group: int, progress: Progress
    ) -> Float32Array:
        """Return what the samples see along the (a, 3) axes of group number `group`, see VisibilityTester."""
        turns = len(self.faces)
        if turns == 1:
            return tester.accumulate(samples, axes, progress)
        # Every second axis, or every eighth, would be an uneven set; by the golden ratio they are even for any number.
        whose = ((np.arange(len(axes)) * INV_GOLDEN_RATIO + group * INV_GOLDEN_RATIO**2) % 1.0 * turns).astype(int)
        sums = np.zeros((len(samples.faces), 2), np.float32)
        for turn in np.unique(whose).tolist():
            sums += tester.accumulate(self._at(samples, turn), axes[whose == turn], progress)
        return sums

    def _at(self, samples: Samples, turn: int) -> Samples:
        """Return the samples as those whose turn it is have them."""
        there = samples.faces >= 0
        swapped = there & self.swapped[turn][samples.faces]
        weights = np.where(swapped[:, None], samples.weights[:, REVERSED_WINDING], samples.weights)
        return Samples(np.where(there, self.faces[turn][samples.faces], np.int32(-1)), weights)
