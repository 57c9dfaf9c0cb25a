"""From what a reader found in a file, or from arrays, to a checked Scene: the same checks for every format."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoprecalc.errors import ArgumentError, InputError, counted, one_or_many
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.mesh.surface import face_normals, normalize, smooth_normals
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.progress import Note, notes_of, warnings_of
from aoprecalc.types import Atlas, Float32Array, Float64Array, Int32Array, Material, Part, Scene


def damaged_file(path: Path, found: str) -> InputError:
    """Return the error for a damaged file; `found` says what was found and what was expected."""
    return InputError(f"{path}: {found}; the file is damaged, export it again")


def check_indices(path: Path, indices: NDArray[Any], count: int) -> None:
    """Raise InputError unless all vertex indices of faces are within [0, count)."""
    wrong = indices[(indices < 0) | (indices >= count)]
    if wrong.size:
        raise damaged_file(path, f"a face refers to vertex {wrong.flat[0]}, but there are {count} (counted from 0)")


# Coordinates beyond this overflow when squared twice, and no unit of length needs them.
MAX_COORDINATE = 1e30
_MIN_EXTENT = 1e-30  # products of areas below it underflow

# UVs beyond this have lost the digits that tell texels apart.
_MAX_UV = 1e5


@dataclass(frozen=True, eq=False)
class MeshPiece:
    """Faces of a file that belong together (a group, a glTF primitive), as read and not yet checked.

    name       as in the file, or made up
    positions  (n, 3) float64 in world space; pieces may share one array
    vertices   (f, 3) integers into positions, counter-clockwise seen from the front
    normals    (f, 3, 3) at the corners, of any length, NaN where the file has none; None if it has none at all
    uv_sets    each (f, 3, 2) at the corners, v upwards, NaN where the file has none
    source     becomes Part.source
    names      become Part.names
    material   becomes Part.material
    """

    name: str
    positions: Float64Array
    vertices: NDArray[np.int64]
    normals: NDArray[Any] | None = None
    uv_sets: tuple[NDArray[Any], ...] = ()
    source: object = None
    names: Collection[str | None] = ()
    material: Material = field(default_factory=Material)


def build_scene(
    path: Path,
    file_format: str,
    pieces: Sequence[MeshPiece],
    document: object = None,
    messages: Sequence[str] = (),
    *,
    label: str | None = None,
    welded: tuple[int, float] | None = None,
) -> Scene:
    """Check the pieces of a file, weld equal positions and return them as a Scene.

    file_format   becomes Scene.format
    document      becomes Scene.document
    messages      of the reader: warnings, and each Note among them
    label         the start of error messages; None: the path
    welded        becomes Scene.welded

    Raises InputError if there are no faces, if none has area, if a face refers to a vertex that does not exist or if
    a position that is used is not finite.
    """
    label = label or str(path)
    pieces_with_faces = [piece for piece in pieces if len(piece.vertices)]
    if not pieces_with_faces:
        points = sum(len(array) for array in {id(piece.positions): piece.positions for piece in pieces}.values())
        found = f"{counted(points, 'point')} but no faces" if points else "no faces"
        raise InputError(f"{label}: {found} found, a surface of triangles was expected; export the model as a mesh")
    for piece in pieces_with_faces:
        check_indices(path, piece.vertices, len(piece.positions))

    positions, faces = _weld(pieces_with_faces)
    _check_positions(label, positions)
    messages = list(messages)
    flat_normals, has_area = face_normals(positions[faces])
    if not has_area.any():
        raise InputError(
            f"{label}: none of {counted(len(faces), 'face')} has any area, a surface was expected; "
            "check how it was exported"
        )
    if not has_area.all():
        flat = np.count_nonzero(~has_area)
        skipped = one_or_many(flat, "has no area and is skipped", "have no area and are skipped")
        messages.append(Note(f"{flat} of {counted(len(faces), 'face')} {skipped}"))

    return Scene(
        path=path,
        format=file_format,
        positions=positions,
        faces=faces.astype(np.int32),
        normals=_gather_normals(pieces_with_faces, positions, faces.astype(np.int32), flat_normals, messages),
        uv_sets=_gather_uv_sets(pieces_with_faces, messages),
        parts=_parts(pieces_with_faces),
        document=document,
        welded=welded,
        warnings=warnings_of(messages),
        notes=notes_of(messages),
    )


def _weld(pieces: Sequence[MeshPiece]) -> tuple[Float64Array, NDArray[np.intp]]:
    """Return the (v, 3) distinct positions that faces use, and (f, 3) faces into them."""
    used_positions, corners, offset = [], [], 0
    for piece in pieces:
        used, local = np.unique(piece.vertices, return_inverse=True)
        used_positions.append(piece.positions[used])
        corners.append(local.reshape(-1, 3) + offset)
        offset += len(used)
    positions = np.concatenate(used_positions)
    first, which = unique_rows(positions)
    return positions[first] + 0.0, which[np.concatenate(corners)]  # + 0.0 turns -0.0 into 0.0


def _check_positions(label: str, positions: Float64Array) -> None:
    wrong = ~(np.abs(positions) <= MAX_COORDINATE).all(axis=1)
    if not wrong.any():
        extent = np.ptp(positions, axis=0).max()
        if 0 < extent < _MIN_EXTENT:
            raise InputError(
                f"{label}: is {extent:g} units across, at least {_MIN_EXTENT:g} were expected; scale it up"
            )
        return
    bad = np.count_nonzero(wrong)
    example = ", ".join(f"{number:.9g}" for number in positions[wrong][0])
    raise InputError(
        f"{label}: {bad} of {counted(len(positions), 'position')} {one_or_many(bad, 'is', 'are')} not finite or of no "
        f"usable size, such as ({example}); repair or export the model again"
    )


def _gather_normals(
    pieces: Sequence[MeshPiece],
    positions: Float64Array,
    faces: Int32Array,
    face_normals: Float64Array,
    messages: list[str],
) -> Float32Array | None:
    """Return (f, 3, 3) unit normals at the corners, smooth on parts that have none; None if none is usable.

    faces   (f, 3) into the welded positions
    """
    with_normals = [piece.normals for piece in pieces if piece.normals is not None]
    if not with_normals:
        return None
    lacks = np.repeat([piece.normals is None for piece in pieces], [len(piece.vertices) for piece in pieces])
    normals = np.empty((len(faces), 3, 3))
    normals[~lacks] = np.concatenate(with_normals)
    if lacks.any():
        normals[lacks] = smooth_normals(positions, faces[lacks])
    largest = np.abs(normals).max(axis=2, keepdims=True)
    usable = np.asarray((np.isfinite(largest) & (largest > 0))[:, :, 0])
    if not usable[~lacks].any():
        messages.append(Note("all normals of the file are zero or not finite: they are computed from the faces"))
        return None
    if missing := len(pieces) - len(with_normals):
        without = f"{missing} of {counted(len(pieces), 'part')} {one_or_many(missing, 'has', 'have')} no normals"
        messages.append(Note(f"{without}: smooth ones were computed there"))
    if not usable.all():
        messages.append(
            Note(
                f"no usable normal at {np.count_nonzero(~usable)} of {usable.size} corners; "
                "the normal of the face is used there"
            )
        )
        normals = np.where(usable[:, :, None], normals, face_normals[:, None])
        largest = np.abs(normals).max(axis=2, keepdims=True)
    normals = normals / largest  # avoids underflow and overflow when squaring
    return normalize(normals).astype(np.float32)


def _gather_uv_sets(pieces: Sequence[MeshPiece], messages: list[str]) -> tuple[Float64Array, ...]:
    """Return the UV sets of all faces, each (f, 3, 2) float64; (0, 0) where the file has no UVs."""
    sets = []
    for index in range(max(len(piece.uv_sets) for piece in pieces)):
        has_set = np.repeat([index < len(piece.uv_sets) for piece in pieces], [len(piece.vertices) for piece in pieces])
        uvs = np.full((len(has_set), 3, 2), np.nan)
        uvs[has_set] = np.concatenate([piece.uv_sets[index] for piece in pieces if index < len(piece.uv_sets)])
        usable = np.asarray((np.abs(uvs) <= _MAX_UV).all(axis=2))  # False for NaN
        incomplete = np.count_nonzero(has_set & ~usable.all(axis=1))
        if incomplete and index == 0:
            messages.append(
                f"{incomplete} of {counted(len(uvs), 'face')} {one_or_many(incomplete, 'lacks', 'lack')} usable UVs"
            )
        sets.append(np.where(usable[:, :, None], uvs, 0.0))
    return tuple(sets)


def _parts(pieces: Sequence[MeshPiece]) -> tuple[Part, ...]:
    parts, start = [], 0
    for piece in pieces:
        stop = start + len(piece.vertices)
        names = frozenset(name for name in piece.names if name)
        parts.append(
            Part(piece.name, start, stop, piece.vertices.astype(np.int32), piece.source, names, piece.material)
        )
        start = stop
    return tuple(parts)


def cofactors(linear: Float64Array) -> Float64Array:
    """Return the cofactors of (..., 3, 3) matrices: they transform normals, up to length, and always exist."""
    a, b, c = linear[..., 0, :], linear[..., 1, :], linear[..., 2, :]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)


# Arrays in the place of a file: every error names the Python argument, what was found and expected.

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

    def output_extension(self, scene: Scene, atlases: Sequence[Atlas]) -> tuple[str, str]:
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
