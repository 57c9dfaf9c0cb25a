"""Pictures of results, drawn by NumPy alone: no OpenGL, no display."""

from aoprecalc.render.comparison import comparison_picture
from aoprecalc.render.spheres import spheres_panels, spheres_picture

__all__ = ["comparison_picture", "spheres_panels", "spheres_picture"]
