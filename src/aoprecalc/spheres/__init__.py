"""Spheres that stand in for a surface (section 1.2 of *Précalcul*, and beyond it): sample, fit, measure.

NumPy and SciPy only.
"""

from aoprecalc.spheres.fit import fit_sphere_set, measure_quality
from aoprecalc.spheres.metrics import Quality

__all__ = ["Quality", "fit_sphere_set", "measure_quality"]
