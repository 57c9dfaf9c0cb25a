"""Pictures of results: previews by OpenGL or rays, shaded by NumPy; false-colour pictures of errors."""

from aoprecalc.render.comparison import comparison_picture
from aoprecalc.render.preview import preview_pictures
from aoprecalc.render.rasterizer import preview_image, preview_panels

__all__ = ["comparison_picture", "preview_image", "preview_panels", "preview_pictures"]
