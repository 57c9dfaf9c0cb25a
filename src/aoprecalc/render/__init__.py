"""Pictures of results, drawn by NumPy alone: no OpenGL, no display."""

from aoprecalc.render.comparison import comparison_picture
from aoprecalc.render.preview import preview_image, preview_panels

__all__ = ["comparison_picture", "preview_image", "preview_panels"]
