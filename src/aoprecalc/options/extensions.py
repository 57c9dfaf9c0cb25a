"""The file extensions that commands take, stated once for `--help`, docstrings and messages.

Standard library only. A test holds the lists to the formats that `aoprecalc.io` reads and writes.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

IMAGE_EXTENSIONS = (".png", ".exr", ".tif", ".tiff", ".jpg", ".jpeg", ".tga", ".bmp")
MESH_EXTENSIONS = (".obj", ".ply", ".stl", ".off", ".gltf", ".glb", ".dae", ".zae", ".3mf")  # read
BAKED_MESH_EXTENSIONS = (".obj", ".ply", ".gltf", ".glb")  # written, with the UVs of a bake
SPHERE_EXTENSIONS = (".json", ".csv", ".npz", ".ply", ".obj", ".glb", ".yml", ".yaml", ".urdf", ".usda")

Documented = TypeVar("Documented", bound=Callable[..., Any])


def listed(extensions: Iterable[str]) -> str:
    """Return extensions as help texts and docstrings show them."""
    return " ".join(extensions)


_LISTS = {
    "{images}": listed(IMAGE_EXTENSIONS),
    "{meshes}": listed(MESH_EXTENSIONS),
    "{baked meshes}": listed(BAKED_MESH_EXTENSIONS),
    "{sphere sets}": listed(SPHERE_EXTENSIONS),
}


def with_extensions(text: str) -> str:
    """Return a text with the lists in place of {images}, {meshes}, {baked meshes} and {sphere sets}."""
    for name, extensions in _LISTS.items():
        text = text.replace(name, extensions)
    return text


def names_extensions(function: Documented) -> Documented:
    """Put the lists into the docstring of a function; see `with_extensions`."""
    function.__doc__ = with_extensions(function.__doc__ or "")
    return function
