"""Scenes and textures from arrays, checked: every error names the Python argument, what was found and expected."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoprecalc.errors import ArgumentError, InputError
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MeshPiece, build_scene
from aoprecalc.types import Atlas, Float32Array, Float64Array, Int32Array, Scene

_ROUNDING = 1e-3  # by which values of textures may leave [0, 1]; float16 resolves half of it
Shape = tuple[str | int, ...]  # letters stand for any size


class ArraysFormat(MeshFormat):
    """The format of scenes that come from arrays (Scene.format is empty): no file; written as GLB."""

    name = "arrays"
    extensions = ()

    def sniff(self, data: bytes) -> bool:
        """Return False: no file has this format."""
        return False

    def read(self, path: Path, data: bytes) -> Scene:
        """Raise InputError: there is nothing to read."""
        raise InputError(f"{path}: is not a mesh file")

    def source_files(self, scene: Scene) -> list[Path]:
        """Return nothing."""
        return []

    def output_extension(self, scene: Scene, atlas: Atlas | None) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", ""


def scene_from_arrays(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    normals: ArrayLike | None = None,
    uvs: ArrayLike | None = None,
    name: str = "mesh",
) -> Scene:
    """Make a Scene of one part from arrays, exactly as a file reader does: equal positions are welded.

    vertices  (v, 3) finite numbers
    faces     (f, 3) integers into vertices, f >= 1, counter-clockwise seen from the front
    normals   (v, 3) at the vertices or (f, 3, 3) at the corners, of any length
    uvs       (v, 2) at the vertices or (f, 3, 2) at the corners, v upwards
    name      of the part, and of the scene where a path is shown

    Scene.format is empty, for no file was read. Raises ArgumentError for a wrong array, InputError where no face has
    an area or a position is too large.
    """
    positions = numbers("vertices", vertices, ("V", 3))
    triangles = indices("faces", faces, ("F", 3), len(positions)).astype(np.int64)

    def per_corner(argument: str, values: ArrayLike, size: int) -> Float64Array:
        array = numbers(argument, values, (len(positions), size), (len(triangles), 3, size))
        return array if array.ndim == 3 else array[triangles]

    corner_normals = None if normals is None else per_corner("normals", normals, 3)
    uv_sets = () if uvs is None else (per_corner("uvs", uvs, 2),)
    piece = MeshPiece(name, positions, triangles, corner_normals, uv_sets)
    return build_scene(Path(name), "", [piece], label="vertices, faces")


def numbers(argument: str, values: ArrayLike, *shapes: Shape) -> Float64Array:
    """Return finite real numbers of one of the shapes as a new float64 array; raises ArgumentError for others."""
    array = _array(argument, values, shapes)
    if array.dtype.kind not in "iuf" and array.size:
        raise ArgumentError(argument, f"has the dtype {array.dtype}, real numbers were expected")
    with np.errstate(over="ignore"):
        result: Float64Array = array.astype(np.float64)
    if not np.isfinite(result).all():
        first = tuple(np.argwhere(~np.isfinite(result))[0].tolist())
        raise ArgumentError(argument, f"is {result[first]} at {list(first)}, finite numbers were expected")
    return result


def indices(argument: str, values: ArrayLike, shape: Shape, count: int) -> Int32Array:
    """Return indices below `count` as a new int32 array; raises ArgumentError for others."""
    array = _array(argument, values, (shape,))
    if array.dtype.kind not in "iu":
        raise ArgumentError(argument, f"has the dtype {array.dtype}, integers were expected")
    if not count:
        raise ArgumentError("vertices", "is empty, at least three vertices were expected")
    wrong = array[(array < 0) | (array >= count)]
    if wrong.size:
        raise ArgumentError(argument, f"refers to vertex {wrong[0]}, indices from 0 to {count - 1} were expected")
    return array.astype(np.int32)


def checked_spheres(centers: ArrayLike, radii: ArrayLike) -> tuple[Float64Array, Float64Array]:
    """Return spheres as (n, 3) and (n,) float64, n >= 1; raises ArgumentError for arrays that are none."""
    points = numbers("centers", centers, ("n", 3))
    lengths = numbers("radii", radii, (len(points),))
    if not len(points):
        raise ArgumentError("centers", "has no rows, at least one sphere was expected")
    if lengths.min() < 0:
        raise ArgumentError("radii", f"has the value {lengths.min():g}, numbers >= 0 were expected")
    return points, lengths


def texture_values(argument: str, values: ArrayLike) -> Float32Array:
    """Return a texture in [0, 1], (h, w) float32, from numbers, or from unsigned integers over their whole range.

    Numbers that rounding has moved out of [0, 1] are clipped; raises ArgumentError for others beyond it.
    """
    array = numbers(argument, values, ("H", "W"), ("H", "W", 1))
    if not array.size:
        raise ArgumentError(argument, f"has the shape {array.shape}, at least one texel was expected")
    dtype = np.asarray(values).dtype
    if dtype.kind == "u":
        array /= np.iinfo(dtype).max
    low, high = array.min(), array.max()
    if low < -_ROUNDING or high > 1 + _ROUNDING:
        advice = "divide them by 255" if low >= 0 and 1.5 < high <= 255 else "clip or scale them"
        raise ArgumentError(argument, f"has values from {low:g} to {high:g}, 0 to 1 were expected; {advice}")
    return np.clip(array.reshape(array.shape[:2]), 0, 1).astype(np.float32)


def _array(argument: str, values: ArrayLike, shapes: Sequence[Shape]) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except (RuntimeError, TypeError, ValueError) as error:  # rows of different lengths, a tensor on another device
        raise ArgumentError(argument, f"is not an array of numbers, shape {_either(shapes)} was expected") from error
    for shape in shapes:
        same = (isinstance(size, str) or size == found for size, found in zip(shape, array.shape, strict=False))
        if len(shape) == array.ndim and all(same):
            return array
    found = f"has the shape {array.shape}," if array.ndim else f"is of type {type(values).__name__}, the shape"
    raise ArgumentError(argument, f"{found} {_either(shapes)} was expected")


def _either(shapes: Sequence[Shape]) -> str:
    return " or ".join(f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})" for shape in shapes)
