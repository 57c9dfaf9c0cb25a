"""Sphere sets on disk, as tables, as scenes and as JSON; `files.SPHERE_FORMATS` lists the formats by extension."""

from aoprecalc.io.sphere_files.files import SPHERE_EXTENSIONS, check_sphere_extension, read_spheres, write_sphere_set
from aoprecalc.io.sphere_files.tables import quality_document, read_sphere_set, sphere_document

__all__ = [
    "SPHERE_EXTENSIONS",
    "check_sphere_extension",
    "quality_document",
    "read_sphere_set",
    "read_spheres",
    "sphere_document",
    "write_sphere_set",
]
