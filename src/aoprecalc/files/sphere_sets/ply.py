"""Sphere sets as PLY: binary points with the properties x, y, z and radius."""

import numpy as np

from aoprecalc.model import SphereSet

PROPERTIES = ("x", "y", "z", "radius")


def ply_points(spheres: SphereSet) -> bytes:
    """Lay out one vertex a sphere, all four properties float64."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(spheres)}",
        *(f"property double {name}" for name in PROPERTIES),
        "end_header\n",
    ]
    rows = np.column_stack([spheres.centers, spheres.radii]).astype("<f8")
    return "\n".join(header).encode() + rows.tobytes()
