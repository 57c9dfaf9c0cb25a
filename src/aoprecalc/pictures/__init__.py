"""Pictures of results, drawn by NumPy alone: no OpenGL, no display."""

from aoprecalc.pictures.comparison_picture import comparison_picture
from aoprecalc.pictures.spheres_picture import spheres_panels, spheres_picture

__all__ = ["comparison_picture", "spheres_panels", "spheres_picture"]
