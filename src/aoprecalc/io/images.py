"""Pictures, mostly of one linear channel, written and read through OpenImageIO.

Rounding is ours: in 8 bits a value a becomes floor(255 a + 0.5), in 16 bits floor(65535 a + 0.5), and what lies
outside [0, 1] becomes the nearest end.
"""

import tempfile
import textwrap
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.options import BitDepth
from aoprecalc.types import Float32Array

Depth = Literal["8", "16", "half", "float"]

# What each kind of file can hold; the first is what `auto` means.
BIT_DEPTHS: dict[str, tuple[Depth, ...]] = {
    ".png": ("8", "16"),
    ".exr": ("half", "float"),
    ".tif": ("8", "16", "half", "float"),
    ".tiff": ("8", "16", "half", "float"),
    ".jpg": ("8",),
    ".jpeg": ("8",),
    ".tga": ("8",),
    ".bmp": ("8",),
}

IMAGE_EXTENSIONS = tuple(BIT_DEPTHS)

# These note when they were written unless told a date; the same picture must give the same bytes.
DATED = (".exr", ".tif", ".tiff")
NO_DATE = "1970:01:01 00:00:00"

_TYPES = {"8": "uint8", "16": "uint16", "half": "half", "float": "float"}


def choose_bit_depth(path: str | PathLike[str], bit_depth: BitDepth) -> Depth:
    """Return the depth in which a picture of that name is written.

    Raises UsageError for an extension that is not known, and for a depth that it cannot hold.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in BIT_DEPTHS:
        raise UsageError(
            f"{path}: the extension {suffix or '(none)'} is no picture's, one of {', '.join(BIT_DEPTHS)} was expected"
        )
    if bit_depth == "auto":
        return BIT_DEPTHS[suffix][0]
    if bit_depth not in BIT_DEPTHS[suffix]:
        raise UsageError(
            f"{path}: {suffix} holds no values of depth {bit_depth}, it takes {', '.join(BIT_DEPTHS[suffix])}; "
            "choose another extension or depth"
        )
    return bit_depth


def write_image(path: str | PathLike[str], values: Float32Array, bit_depth: BitDepth = "auto") -> None:
    """Write a picture, its kind by the extension of `path`; the same values give the same bytes.

    values   (height, width) or (height, width, channels) float32; row 0 is the upper one

    Raises UsageError as `choose_bit_depth` does, and OutputError where it cannot be written.
    """
    depth = choose_bit_depth(path, bit_depth)
    _write(path, np.atleast_3d(quantize(values, depth)), depth, space="data")  # else PNG is tagged sRGB


def png_bytes(values: Float32Array) -> bytes:
    """Return the bytes of a PNG of 8 bits that `write_image` makes of such values."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        write_image(file, values, "8")
        return file.read_bytes()


def write_colors(path: str | PathLike[str], colors: NDArray[np.uint8]) -> None:
    """Write a picture to look at, (height, width, 3) RGB in sRGB; row 0 is the upper one.

    Raises UsageError for a kind of file that holds no 8 bits, and OutputError where it cannot be written.
    """
    _write(path, colors, choose_bit_depth(path, "8"), space="sRGB")


def _write(path: str | PathLike[str], pixels: NDArray[Any], depth: Depth, space: str) -> None:
    import OpenImageIO

    OpenImageIO.attribute("tiff:half", 1)  # else 16-bit floats are stored as 32-bit ones
    buffer = OpenImageIO.ImageBuf(np.ascontiguousarray(pixels))
    spec = buffer.specmod()
    spec.attribute("oiio:ColorSpace", space)
    if Path(path).suffix.lower() in DATED:
        spec.attribute("DateTime", NO_DATE)
    if not buffer.write(str(path), _TYPES[depth]):
        raise OutputError(f"{path}: the picture cannot be written ({_line(buffer.geterror())}); choose another output")


def quantize(values: Float32Array, depth: Depth) -> NDArray[Any]:
    """Return values of [0, 1], or beyond, in the type in which they are stored: uint8, uint16, float16 or float32."""
    if depth == "float":
        return np.asarray(values, dtype=np.float32)
    if depth == "half":
        return np.asarray(values, dtype=np.float16)
    most = 255 if depth == "8" else 65535
    scaled = np.floor(np.clip(values, 0.0, 1.0).astype(np.float64) * most + 0.5)
    return scaled.astype(np.uint8 if depth == "8" else np.uint16)


def read_image(path: str | PathLike[str]) -> Float32Array:
    """Return the (height, width) float32 values of a picture's first channel; see `read_pixels`."""
    return np.ascontiguousarray(read_pixels(path)[:, :, 0])


def read_pixels(path: str | PathLike[str]) -> Float32Array:
    """Return the (height, width, channels) float32 values of a picture; integers come as fractions of their most.

    They are as in the file: neither decoded as colours nor multiplied by its alpha.

    Raises InputError where it is missing or cannot be read.
    """
    import OpenImageIO

    if Path(path).is_dir():
        raise InputError(f"{path}: is a folder, a picture was expected")
    if not Path(path).is_file():
        raise InputError(f"{path}: there is no such file, a picture was expected; check the path")
    as_stored = OpenImageIO.ImageSpec()
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    buffer = OpenImageIO.ImageBuf(str(path), 0, 0, as_stored)
    pixels = None if buffer.has_error else buffer.get_pixels("float")
    if pixels is None or buffer.has_error:
        reason = _line(buffer.geterror())
        raise InputError(f"{path}: cannot be read as a picture ({reason}); check the file or convert it to PNG")
    return np.ascontiguousarray(pixels, dtype=np.float32)


def decode_pixels(data: bytes, name: str) -> Float32Array:
    """Read a picture, as `read_pixels` does, from the bytes of its file; errors call it by `name`."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "picture.png"  # what it is shows in the bytes, whatever it is called
        copy.write_bytes(data)
        try:
            return read_pixels(copy)
        except InputError as error:
            raise InputError(str(error).replace(str(copy), name)) from error


def _line(text: str) -> str:
    return textwrap.shorten(text, 160, placeholder=" ...") or "unknown reason"
