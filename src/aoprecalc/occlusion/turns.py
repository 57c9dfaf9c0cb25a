"""Instances that have one place in the texture together take turns at it: each group of axes looks from another one."""

from dataclasses import dataclass, replace

import numpy as np

from aoprecalc.model import Ints, Mask, Scene
from aoprecalc.occlusion.axes import groups
from aoprecalc.texspace.samples import Samples

_SWAPPED = [0, 2, 1]


@dataclass(frozen=True, eq=False)
class Turns:
    """Whose turn it is.

    faces     (t, f) int32: the face from which a sample on each face looks at each turn
    swapped   (t, f) bool: that face has its second and third corners the other way round
    """

    faces: Ints
    swapped: Mask

    @classmethod
    def of(cls, scene: Scene, axes: int) -> "Turns | None":
        """Let the sharers of a place follow each other, evenly chosen where they are more than turns; None: none share.

        A turn takes two groups of axes, as their difference is to tell the error of sampling, not that of sharing.
        """
        sharers: dict[int, list[int]] = {}
        for number, part in enumerate(scene.parts):
            if part.shares is not None:
                sharers.setdefault(part.shares, [part.shares]).append(number)
        if not sharers:
            return None
        turns = min(max(map(len, sharers.values())), -(-len(groups(axes)) // 2))
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

    def at(self, samples: Samples, turn: int) -> Samples:
        """Return the samples as those whose turn it is have them."""
        turn %= len(self.faces)
        there = samples.faces >= 0
        swapped = there & self.swapped[turn][samples.faces]
        weights = np.where(swapped[:, None], samples.weights[:, _SWAPPED], samples.weights)
        return replace(samples, faces=np.where(there, self.faces[turn][samples.faces], -1), weights=weights)
