"""What all readers of sphere sets ask of a file: that it is there, and that its numbers are spheres."""

from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.model import Doubles


def source_bytes(path: Path) -> bytes:
    """Return what is in a file; raises InputError where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a sphere set") from error


def check_spheres(path: Path, centers: Doubles, radii: Doubles) -> None:
    """Raise InputError unless there are n >= 1 centers (n, 3) and radii (n,), all finite, no radius below 0."""
    if radii.ndim != 1 or len(radii) == 0 or centers.shape != (len(radii), 3):
        raise InputError(f"{path}: expected at least one sphere, each with a center [x, y, z] and a radius")
    if not np.isfinite(centers).all() or not (np.isfinite(radii) & (radii >= 0)).all():
        raise InputError(f"{path}: expected finite centers and finite radii >= 0, found others; mend the file")
