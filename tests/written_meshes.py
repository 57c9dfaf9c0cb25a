"""Meshes that are written with one texture of a bake, as most tests of writers need them."""

from pathlib import Path

from aoprecalc.io import write_baked_mesh
from aoprecalc.io.formats.base import MeshWithAo
from aoprecalc.io.formats.textures import MeshTexture


def write_with_one_texture(outputs, path, scene, atlas, normals, picture, **options):
    """Write a scene whose baked faces all have one texture, of an atlas; options are those of MeshWithAo."""
    texture = MeshTexture("", Path(picture), atlas, scene.receives)
    return write_baked_mesh(outputs, path, MeshWithAo(scene, (texture,), normals, **options))
