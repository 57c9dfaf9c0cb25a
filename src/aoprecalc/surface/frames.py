"""Two directions at right angles to a given one."""

import numpy as np

from aoprecalc.model import Doubles


def perpendiculars(units: Doubles) -> tuple[Doubles, Doubles]:
    """Return two unit vectors, (k, 3) each, that make a right-handed frame with each of (k, 3) unit vectors.

    (J. R. Frisvad, 2012; T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.)
    """
    x, y, z = units.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    across = np.column_stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    upward = np.column_stack([b, sign + y * y * a, -y])
    return across, upward
