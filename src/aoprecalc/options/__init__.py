"""What can be chosen about a job, with the defaults. Standard library only, so that `aoprecalc --help` is instant.

`fields` says how an option is stated; each class here states the options of one command. The extensions of the files
that commands take are stated here as well, for `--help`, docstrings and messages; a test holds them to the formats that
`aoprecalc.io` reads and writes.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from aoprecalc.options.bake import (  # fmt: skip
    LARGE_MESH,
    Backend,
    BakeOptions,
    BentSpace,
    BitDepth,
    Estimator,
    Falloff,
    Fill,
    Green,
    Instances,
    LightOptions,
    Match,
    Normals,
    Pack,
    Sampling,
    Textures,
    Unwrap,
    Up,
    ValueOptions,
    VertexAo,
    Weight,
)
from aoprecalc.options.others import (  # fmt: skip
    BatchOptions,
    CompareOptions,
    FigureOptions,
    Init,
    Method,
    PreviewOptions,
    Radius,
    Shading,
    Ship,
    SphereOptions,
    SpheresView,
    VerifyOptions,
)

__all__ = [
    "BAKED_MESH_EXTENSIONS",
    "IMAGE_EXTENSIONS",
    "LARGE_MESH",
    "MESH_EXTENSIONS",
    "PICTURE_EXTENSIONS",
    "SPHERE_EXTENSIONS",
    "Backend",
    "BakeOptions",
    "BatchOptions",
    "BentSpace",
    "BitDepth",
    "CompareOptions",
    "Estimator",
    "Falloff",
    "FigureOptions",
    "Fill",
    "Green",
    "Init",
    "Instances",
    "LightOptions",
    "Match",
    "Method",
    "Normals",
    "Pack",
    "PreviewOptions",
    "Radius",
    "Sampling",
    "Shading",
    "Ship",
    "SphereOptions",
    "SpheresView",
    "Textures",
    "Unwrap",
    "Up",
    "ValueOptions",
    "VerifyOptions",
    "VertexAo",
    "Weight",
    "listed",
    "names_extensions",
    "with_extensions",
]  # fmt: skip

IMAGE_EXTENSIONS = (".png", ".exr", ".tif", ".tiff", ".jpg", ".jpeg", ".tga", ".bmp")
PICTURE_EXTENSIONS = (".png", ".jpg", ".jpeg", ".webp")  # of what people look at
MESH_EXTENSIONS = (  # read
    ".obj", ".ply", ".stl", ".off", ".gltf", ".glb", ".vrm", ".dae", ".zae", ".3mf", ".usd", ".usda", ".usdc", ".usdz",
    ".fbx", ".zip",
)  # fmt: skip
BAKED_MESH_EXTENSIONS = (  # written, with the UVs of a bake
    ".obj", ".ply", ".gltf", ".glb", ".vrm", ".usd", ".usda", ".usdc", ".usdz",
)  # fmt: skip
SPHERE_EXTENSIONS = (".json", ".csv", ".npz", ".ply", ".obj", ".glb", ".yml", ".yaml", ".urdf", ".usda")

Documented = TypeVar("Documented", bound=Callable[..., Any])


def listed(extensions: Iterable[str]) -> str:
    """Return extensions as help texts and docstrings show them."""
    return " ".join(extensions)


_LISTS = {
    "{images}": listed(IMAGE_EXTENSIONS),
    "{pictures}": listed(PICTURE_EXTENSIONS),
    "{meshes}": listed(MESH_EXTENSIONS),
    "{baked meshes}": listed(BAKED_MESH_EXTENSIONS),
    "{sphere sets}": listed(SPHERE_EXTENSIONS),
}


def with_extensions(text: str) -> str:
    """Return a text with the lists in place of {images}, {pictures}, {meshes}, {baked meshes} and {sphere sets}."""
    for name, extensions in _LISTS.items():
        text = text.replace(name, extensions)
    return text


def names_extensions(function: Documented) -> Documented:
    """Put the lists into the docstring of a function; see `with_extensions`."""
    function.__doc__ = with_extensions(function.__doc__ or "")
    return function
