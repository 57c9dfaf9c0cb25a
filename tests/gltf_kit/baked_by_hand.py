"""Baked meshes without a bake: an atlas and a texture made by code, written by the writer of the format."""

import numpy as np

from aoprecalc.io import Outputs, write_image
from aoprecalc.types import Atlas
from written_meshes import write_with_one_texture


def make_atlas(scene, method="xatlas"):
    """Each face a triangle of its own, in a grid; or UVs of the scene: "keep" the first set, "keep 1" the second."""
    count = len(scene.faces)
    if method.startswith("keep"):
        uv_set = int(method[4:] or 0)
        return Atlas("keep", scene.uv_sets[uv_set], np.ones(count, dtype=bool), count, uv_set=uv_set)
    side = int(np.ceil(np.sqrt(count)))
    cells = np.stack([np.arange(count) % side, np.arange(count) // side], axis=1)[:, None]
    uvs = (cells + np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]])) / side
    return Atlas(method, uvs, np.ones(count, dtype=bool), count)


def make_normals(scene):
    """Normals of unit length that differ from corner to corner and from any file's."""
    normals = np.cos(np.arange(len(scene.faces) * 9)).reshape(-1, 3, 3)
    return (normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32)


def write_with_texture(scene, path, method="xatlas", normals=None, texture="x_ao.png", **options):
    """Write a scene with an atlas and normals of above, or the given normals; (path, atlas, normals, messages)."""
    atlas = make_atlas(scene, method)
    normals = make_normals(scene) if normals is None else normals
    with Outputs() as outputs:
        outputs.folder(path.parent)
        picture = path.parent / texture
        write_image(outputs.path(picture), np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8))
        messages = write_with_one_texture(outputs, path, scene, atlas, normals, picture, **options).messages
    return path, atlas, normals, messages
