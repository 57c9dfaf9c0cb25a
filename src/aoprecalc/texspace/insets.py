"""Keeps samples off chart borders: at a crease, a point there would lie in the very wall that ought to hide it."""

import numpy as np

from aoprecalc.model import Floats, Ints
from aoprecalc.texspace.layout import Layout
from aoprecalc.texspace.samples import ASIDE, DEEPEST, INWARD


def least_weights(layout: Layout) -> Floats:
    """Return how much of each corner the samples on a face must have, (f, 3) float32, 0 where no border is opposite.

    f is one more than the greatest face of the layout. A border's samples lie INWARD texels from it, or less where the
    face is too thin for that; see border.frag.glsl.
    """
    least: Floats = np.zeros((int(layout.faces.max(initial=-1)) + 1, 3), np.float32)
    start, end, apex = layout.borders.transpose(1, 0, 2)
    along, left, right = end - start, apex - start, apex - end
    length = np.maximum(np.hypot(*along.T), 1e-9)
    height = np.maximum(np.abs(along[:, 0] * left[:, 1] - along[:, 1] * left[:, 0]) / length, 1e-9)
    farthest = np.maximum(np.maximum(np.hypot(*left.T), np.hypot(*right.T)), 1e-9)
    shares = np.minimum(DEEPEST, np.minimum(INWARD / height, ASIDE / farthest))
    least[layout.border_faces, (layout.border_corners + 2) % 3] = shares
    return least


def off_borders(weights: Floats, faces: Ints, least: Floats) -> Floats:
    """Return (n, 3) weights of samples moved away from the borders of their faces; -1 is no face."""
    bordering = np.append(least.any(axis=1), False)  # the last one for those without a face
    close = np.flatnonzero(bordering[faces])
    close = close[(weights[close] < least[faces[close]]).any(axis=1)]
    if not len(close):
        return weights
    moved, lowest = weights[close], least[faces[close]]
    raised = np.maximum(moved, lowest)
    spare = raised - lowest  # what the other corners can give
    raised -= spare * ((raised.sum(axis=1) - 1) / np.maximum(spare.sum(axis=1), 1e-9))[:, None]
    result = weights.copy()
    result[close] = raised
    return result
