"""Triangles with holes in them, and the pieces between the holes."""

from aoprecalc.surface.cutouts.opaque import opaque_triangles

__all__ = ["opaque_triangles"]
