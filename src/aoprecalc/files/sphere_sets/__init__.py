"""Sphere sets on disk: one module a format, `write` and `read` choose among them by the extension."""

from aoprecalc.files.sphere_sets.json_document import (
    SCHEMA,
    quality_document,
    read_sphere_set,
    sphere_document,
)
from aoprecalc.files.sphere_sets.read import read_spheres
from aoprecalc.files.sphere_sets.write import KINDS, check_kind, write_sphere_set

__all__ = [
    "KINDS",
    "SCHEMA",
    "check_kind",
    "quality_document",
    "read_sphere_set",
    "read_spheres",
    "sphere_document",
    "write_sphere_set",
]
