"""Meshes, images and sphere sets on disk."""

from aoprecalc.io.formats.builder import scene_from_arrays
from aoprecalc.io.images import choose_depth, read_image, write_colors, write_image
from aoprecalc.io.meshes import check_mesh_suffix, input_files, load_scene, mesh_suffix, source_files, write_baked_mesh
from aoprecalc.io.occlusion import OcclusionPicture, find_occlusion
from aoprecalc.io.outputs import Outputs

__all__ = [
    "OcclusionPicture",
    "Outputs",
    "check_mesh_suffix",
    "choose_depth",
    "find_occlusion",
    "input_files",
    "load_scene",
    "mesh_suffix",
    "read_image",
    "scene_from_arrays",
    "source_files",
    "write_baked_mesh",
    "write_colors",
    "write_image",
]
