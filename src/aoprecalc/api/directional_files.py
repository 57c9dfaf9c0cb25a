"""Pictures of bent normals and of spherical harmonics as files: those that were asked for, and those for the mesh.

A mesh file refers to pictures of integers, in formats that its own format allows; where what was asked for is another,
such as EXR, it gets a copy.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from aoprecalc.api.bake_textures import TextureBake
from aoprecalc.api.bent_normals import bent_picture, encoded, harmonics_picture
from aoprecalc.io import Outputs, choose_bit_depth, write_image
from aoprecalc.io.formats.textures import DirectionalPicture, Directions
from aoprecalc.io.images import BIT_DEPTHS, Depth
from aoprecalc.io.meshes import format_of
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Note
from aoprecalc.types import Baked, Float32Array

_MAKE: dict[Directions, Callable[[Baked, BakeOptions], Float32Array]] = {
    "bent normals": bent_picture,
    "spherical harmonics": harmonics_picture,
}
_COPY = ".png"
_COMPRESSION = 4  # of PNG: a third of the time that 6 takes, and 7% larger


@dataclass(frozen=True)
class WrittenPictures:
    """Pictures of one kind, one for each texture of a bake.

    paths   those that were asked for; none where none were
    shown   those that the mesh is to refer to, of each texture; none where its format cannot
    notes   for the user
    """

    paths: tuple[Path, ...] = ()
    shown: tuple[DirectionalPicture, ...] = ()
    notes: tuple[Note, ...] = ()


def write_pictures(
    outputs: Outputs,
    holds: Directions,
    paths: Sequence[Path],
    textures: Sequence[TextureBake],
    options: BakeOptions,
    mesh: Path,
    folder: Path | None,
) -> WrittenPictures:
    """Write a picture for each texture of a bake.

    paths    of the pictures
    mesh     that is to refer to them
    folder   for copies that go into the mesh only; None: they go beside it
    """
    if folder is not None:
        folder.mkdir()
    mesh_format, shown, copied = format_of(mesh), list[DirectionalPicture](), False
    for path, texture in zip(paths, textures, strict=True):
        pixels = _MAKE[holds](texture.baked, options)
        _write(outputs.path(path), pixels, options)
        if not mesh_format.holds_directional:
            continue
        picture = path
        if path.suffix.lower() not in mesh_format.holds_directional:
            beside = path.with_suffix(_COPY)
            picture, copied = next(outputs.candidates(beside)) if folder is None else folder / beside.name, True
            _write(outputs.path(picture) if folder is None else picture, pixels, options)
        shown.append(DirectionalPicture(holds, picture, options.bent_space, options.green))
    if not copied:
        return WrittenPictures(tuple(paths), tuple(shown))
    found = f"{mesh}: {mesh_format.name} allows no {paths[0].suffix} images; it gets a copy of the {holds} as PNG"
    return WrittenPictures(tuple(paths), tuple(shown), (Note(found),))


def _write(path: Path, pixels: Float32Array, options: BakeOptions) -> None:
    depth = _depth(path, options)
    write_image(path, pixels if depth in ("half", "float") else encoded(pixels), depth, compression=_COMPRESSION)


def _depth(path: Path, options: BakeOptions) -> Depth:
    """Return the bit depth of a picture of directions: that of the options where its format has it."""
    return choose_bit_depth(path, options.bit_depth if options.bit_depth in BIT_DEPTHS[path.suffix.lower()] else "auto")
