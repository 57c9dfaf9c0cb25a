"""Meshes, images and sphere sets on disk."""

from aoprecalc.io.formats.builder import checked_spheres, scene_from_arrays, texture_values
from aoprecalc.io.images import IMAGE_EXTENSIONS, choose_bit_depth, read_image, write_colors, write_image
from aoprecalc.io.meshes import (
    MESH_EXTENSIONS,
    OUTPUT_MESH_EXTENSIONS,
    check_mesh_extension,
    input_files,
    load_scene,
    output_mesh_extension,
    source_files,
    write_baked_mesh,
)
from aoprecalc.io.occlusion import OcclusionTexture, find_occlusion
from aoprecalc.io.outputs import Outputs

__all__ = [
    "IMAGE_EXTENSIONS",
    "MESH_EXTENSIONS",
    "OUTPUT_MESH_EXTENSIONS",
    "OcclusionTexture",
    "Outputs",
    "check_mesh_extension",
    "checked_spheres",
    "choose_bit_depth",
    "find_occlusion",
    "input_files",
    "load_scene",
    "output_mesh_extension",
    "read_image",
    "scene_from_arrays",
    "source_files",
    "texture_values",
    "write_baked_mesh",
    "write_colors",
    "write_image",
]
