"""Meshes, images and sphere sets on disk."""

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.images import choose_depth, read_image, write_image
from aoprecalc.files.meshes import check_mesh_suffix, load_scene, mesh_suffix, source_files, write_baked_mesh

__all__ = [
    "Outputs",
    "check_mesh_suffix",
    "choose_depth",
    "load_scene",
    "mesh_suffix",
    "read_image",
    "source_files",
    "write_baked_mesh",
    "write_image",
]
