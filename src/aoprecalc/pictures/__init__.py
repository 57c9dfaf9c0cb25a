"""Pictures of results, drawn by NumPy alone: no OpenGL, no display."""

from aoprecalc.pictures.spheres_picture import spheres_panels, spheres_picture

__all__ = ["spheres_panels", "spheres_picture"]
