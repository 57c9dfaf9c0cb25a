"""Sphere sets that approximate a surface (*Précalcul*, section 1.2, and more methods): sample, fit, measure.

*Précalcul*: the French report that this software implements (sections 1.1, ambient occlusion, and 1.2, spheres).

NumPy and SciPy only, no files and no OpenGL.
"""

from aoprecalc.spheres.fit import fit_sphere_set, measure_quality
from aoprecalc.spheres.sampling import Quality

__all__ = ["Quality", "fit_sphere_set", "measure_quality"]
