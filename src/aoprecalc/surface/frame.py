"""The coordinates in which visibility is computed, where 32-bit floats resolve the whole mesh equally well."""

import numpy as np

from aoprecalc.model import Doubles


def centred(positions: Doubles) -> Doubles:
    """Move and scale (v, 3) positions into the unit sphere about the origin, which 32-bit floats resolve to 1e-7."""
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
    moved = positions - middle
    radius = np.sqrt((moved**2).sum(axis=1).max())
    scaled: Doubles = moved / (radius if radius > 0 else 1.0)
    return scaled
