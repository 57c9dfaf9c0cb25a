"""A surface in pieces so small that spheres can hold each of them whole."""

import numpy as np

from aoprecalc.model import Doubles


def pieces(corners: Doubles, longest: float) -> Doubles:
    """Halve the longest side of triangles, (f, 3, 3), until none is longer than `longest` > 0; returns (m, 3, 3).

    The pieces cover the triangles exactly, but for the rounding of the middles of sides.
    """
    small = []
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small.append(corners[lengths.max(axis=1) <= longest])
        large = lengths.max(axis=1) > longest
        first = lengths[large].argmax(axis=1)[:, None] + np.arange(
            3
        )  # the longest side runs from the first to the second
        a, b, c = np.take_along_axis(corners[large], first[..., None] % 3, axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack(of, axis=1) for of in ((a, middle, c), (middle, b, c))])
    return np.concatenate(small)
