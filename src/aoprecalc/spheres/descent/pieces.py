"""A surface in pieces so small that spheres can hold each of them whole."""

import numpy as np

from aoprecalc.model import Doubles


def pieces(corners: Doubles, longest: float) -> Doubles:
    """Halve the sides of triangles, (f, 3, 3), until none is longer than `longest` > 0; returns (m, 3, 3).

    The pieces cover the triangles exactly, but for the rounding of the middles of sides.
    """
    small = []
    while len(corners):
        lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        small.append(corners[lengths <= longest])
        a, b, c = corners[lengths > longest].transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(of, axis=1) for of in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate(small)
