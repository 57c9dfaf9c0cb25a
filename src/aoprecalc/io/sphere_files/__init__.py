"""Sphere sets on disk: one module a format, `write` and `read` choose among them by the extension."""

from aoprecalc.io.sphere_files.files import SPHERE_EXTENSIONS, check_sphere_extension, read_spheres, write_sphere_set
from aoprecalc.io.sphere_files.json_format import quality_document, read_sphere_set, sphere_document

__all__ = [
    "SPHERE_EXTENSIONS",
    "check_sphere_extension",
    "quality_document",
    "read_sphere_set",
    "read_spheres",
    "sphere_document",
    "write_sphere_set",
]
