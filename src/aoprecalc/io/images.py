"""Images, mostly of one linear channel, written and read through OpenImageIO.

Integers are quantized here: floor(255 a + 0.5) in 8 bits, floor(65535 a + 0.5) in 16 bits, with a clamped to [0, 1].

An image may carry one text of this program: PNG in a tEXt chunk, EXR in an attribute, both of the name _TEXT; TIFF and
JPEG have it as their ImageDescription, after that name and a space. TGA and BMP carry none. What it says is in
`baked_options.py`.
"""

import os
import shutil
import tempfile
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.options import BitDepth
from aoprecalc.texture_lookup import LUMINANCE
from aoprecalc.types import Float32Array, Picture, UInt8Array

Depth = Literal["8", "16", "half", "float"]

# The bit depths of each file format by extension; the first is the default (`auto`).
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
EXTENSIONS_WITHOUT_TEXT = (".tga", ".bmp")
LOSSY_EXTENSIONS = (".jpg", ".jpeg")

# Of pictures for people; OpenImageIO writes all of them but WebP, which is Pillow's.
PICTURE_EXTENSIONS = (".png", ".jpg", ".jpeg", ".webp")
_WEBP_QUALITY, _ANIMATION_QUALITY, _WEBP_EFFORT = 95, 85, 2  # of 100, of 100, of 6

# Formats that store the time of writing unless given one; equal images must give equal bytes.
_DATED = (".exr", ".tif", ".tiff")
_FIXED_DATE = "1970:01:01 00:00:00"

MAX_SIDE = 32_768  # pixels; a file of half a megabyte may hold more than fit into memory
MAX_TEXT = 16_384  # characters; JPEG holds fewer than 65,536 bytes

_TEXT, _DESCRIPTION = "aoprecalc", "ImageDescription"
_DESCRIBED = (".tif", ".tiff", ".jpg", ".jpeg")  # hold no attributes of other names

_CHANNELS = ("red", "green", "blue")

_OIIO_TYPES = {"8": "uint8", "16": "uint16", "half": "half", "float": "float"}


def choose_bit_depth(path: str | PathLike[str], bit_depth: BitDepth) -> Depth:
    """Return the bit depth of an image written to `path`.

    Raises UsageError for an unknown extension, and for a depth that its format does not have.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in BIT_DEPTHS:
        raise UsageError(
            f"{path}: the extension {suffix or '(none)'} is not that of an image; use one of {', '.join(BIT_DEPTHS)}"
        )
    if bit_depth == "auto":
        return BIT_DEPTHS[suffix][0]
    if bit_depth not in BIT_DEPTHS[suffix]:
        raise UsageError(
            f"{path}: {suffix} has no bit depth {bit_depth}, it has {', '.join(BIT_DEPTHS[suffix])}; "
            "choose another extension or bit depth"
        )
    return bit_depth


def write_image(
    path: str | PathLike[str],
    values: Float32Array,
    bit_depth: BitDepth = "auto",
    text: str = "",
    *,
    compression: int | None = None,
) -> None:
    """Write an image in the format of the extension; equal values and texts give equal bytes.

    values        (height, width) or (height, width, channels) float32; row 0 is the top row
    text          ASCII, at most MAX_TEXT characters, which `read_text` returns; left out where the format holds none
    compression   of PNG, from 0 to 9, which gives the smallest files and takes longest; None: 6

    Raises UsageError as `choose_bit_depth` does, and OutputError where it cannot be written.
    """
    depth = choose_bit_depth(path, bit_depth)
    pixels = np.atleast_3d(quantize(values, depth))
    _write(
        path, pixels, depth, space="data", text=text, compression=compression
    )  # otherwise OpenImageIO tags PNG as sRGB


def png_bytes(values: Float32Array, text: str = "") -> bytes:
    """Return the 8-bit PNG that `write_image` writes, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "image.png"
        write_image(file, values, "8", text)
        return file.read_bytes()


def write_colors(path: str | PathLike[str], colors: NDArray[np.uint8]) -> None:
    """Write an sRGB image, (height, width, 3) uint8; row 0 is the top row.

    Raises UsageError for a format without 8 bits, and OutputError where it cannot be written.
    """
    _write(path, colors, choose_bit_depth(path, "8"), space="sRGB")


def check_picture_extension(path: str | PathLike[str]) -> None:
    """Raise UsageError where no picture for people is written under that name."""
    suffix = Path(path).suffix.lower()
    if suffix not in PICTURE_EXTENSIONS:
        known = ", ".join(PICTURE_EXTENSIONS)
        raise UsageError(f"{path}: the extension {suffix or '(none)'} is not one of {known}; choose one of these")


def write_picture(path: str | PathLike[str], picture: Picture) -> None:
    """Write a picture for people in the format of the extension; equal pictures give equal bytes.

    Raises UsageError for an unknown extension, and OutputError where it cannot be written.
    """
    check_picture_extension(path)
    if Path(path).suffix.lower() == ".webp":
        _write_webp(path, [picture], quality=_WEBP_QUALITY)
    else:
        write_colors(path, picture)


def write_animation(path: str | PathLike[str], pictures: Sequence[Picture], seconds: float) -> None:
    """Write an animated WebP that goes on for ever; raises OutputError where it cannot be written.

    pictures   of one size, at least one
    seconds    from the first picture to the first again
    """
    ends = [round(1000 * seconds * (number + 1) / len(pictures)) for number in range(len(pictures))]
    durations = [end - start for start, end in pairwise([0, *ends])]
    _write_webp(path, pictures, quality=_ANIMATION_QUALITY, duration=durations, loop=0)


def picture_png(picture: Picture) -> bytes:
    """Return the PNG that `write_picture` writes, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        write_picture(file, picture)
        return file.read_bytes()


def _write_webp(path: str | PathLike[str], pictures: Sequence[Picture], **settings: Any) -> None:
    from PIL import Image

    first, *others = (Image.fromarray(picture) for picture in pictures)
    animated = {"save_all": True, "append_images": others, "minimize_size": False} if others else {}
    try:
        first.save(path, "WEBP", method=_WEBP_EFFORT, **animated, **settings)
    except (OSError, ValueError) as error:  # ValueError: the picture is too large for the format
        raise OutputError(f"{path}: the picture cannot be written ({error}); choose another output") from error


def _write(
    path: str | PathLike[str],
    pixels: NDArray[Any],
    depth: Depth,
    space: str,
    text: str = "",
    compression: int | None = None,
) -> None:
    import OpenImageIO

    if not _is_text(path):
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / f"image{Path(path).suffix}"
            _write(copy, pixels, depth, space, text, compression)
            try:
                shutil.copyfile(copy, path)
            except OSError as error:
                found = f"{path}: the image cannot be written ({error.strerror})"
                raise OutputError(f"{found}; choose another output") from error
        return
    OpenImageIO.attribute("tiff:half", 1)  # otherwise 16-bit floats are stored as 32-bit floats
    buffer = OpenImageIO.ImageBuf(np.ascontiguousarray(pixels))
    spec = buffer.specmod()
    spec.attribute("oiio:ColorSpace", space)
    if space == "data":
        spec.attribute("oiio:UnassociatedAlpha", 1)  # else PNG divides the others by a fourth channel
    if compression is not None:
        spec.attribute("png:compressionLevel", compression)
    suffix = Path(path).suffix.lower()
    if suffix in _DATED:
        spec.attribute("DateTime", _FIXED_DATE)
    if text:
        described = suffix in _DESCRIBED
        spec.attribute(_DESCRIPTION if described else _TEXT, f"{_TEXT} {text}" if described else text)
    if not buffer.write(str(path), _OIIO_TYPES[depth]):
        raise OutputError(f"{path}: the image cannot be written ({_reason(buffer)}); choose another output")


def quantize(values: Float32Array, depth: Depth) -> NDArray[Any]:
    """Return values in the stored type, uint8, uint16, float16 or float32; integers are clamped to [0, 1] first."""
    if depth == "float":
        return np.asarray(values, dtype=np.float32)
    if depth == "half":
        return np.asarray(values, dtype=np.float16)
    maximum = 255 if depth == "8" else 65535
    scaled = np.clip(values, 0.0, 1.0).astype(np.float64)
    scaled *= maximum
    scaled += 0.5  # rounded down by the conversion
    return scaled.astype(np.uint8 if depth == "8" else np.uint16)


def stored(values: Float32Array, depth: Depth) -> Float32Array:
    """Return values as they are read back from a stored type, see `quantize`."""
    pixels = quantize(values, depth)
    return np.asarray(
        pixels / np.float32(np.iinfo(pixels.dtype).max) if pixels.dtype.kind == "u" else pixels, np.float32
    )


def read_image(path: str | PathLike[str]) -> Float32Array:
    """Return the first channel of an image, (height, width) float32; see `read_pixels`."""
    return np.ascontiguousarray(read_pixels(path)[:, :, 0])


def read_pixels(path: str | PathLike[str]) -> Float32Array:
    """Return an image as (height, width, channels) float32; integers are divided by their maximum.

    Values are as stored: no colour space conversion, no premultiplied alpha.

    Raises InputError where it is missing or cannot be read.
    """
    return np.ascontiguousarray(_read(path, "float"), dtype=np.float32)


def read_colors(path: str | PathLike[str]) -> UInt8Array:
    """Return the colours of an image, (height, width, 3) uint8 as stored; raises InputError as `read_pixels` does."""
    pixels = _read(path, "uint8")
    return np.ascontiguousarray(pixels[:, :, :3] if pixels.shape[2] > 2 else pixels[:, :, :1].repeat(3, axis=2))


def opacity_of(pixels: Float32Array, channel: str = "") -> Float32Array | None:
    """Return one channel of (h, w, channels) pixels as (h, w) in [0, 1]; None where they have no such channel.

    channel   red, green, blue, alpha or luminance; transparency is the complement of luminance; empty: alpha where
              there is one that is not 1 throughout, else luminance
    """
    channels = pixels.shape[2]
    alpha = np.ascontiguousarray(pixels[:, :, -1]) if channels in (2, 4) else None
    if channel == "alpha" or (not channel and alpha is not None and alpha.min() < 1):
        return alpha
    if channels < 3:
        values = np.ascontiguousarray(pixels[:, :, 0])
    elif channel in _CHANNELS:
        return np.ascontiguousarray(pixels[:, :, _CHANNELS.index(channel)])
    else:
        values = np.asarray(pixels[:, :, :3] @ LUMINANCE, np.float32)
    return 1 - values if channel == "transparency" else values


def channel_count(path: str | PathLike[str]) -> int:
    """Return how many channels an image has, 0 for what is none; its pixels are not decoded."""
    import OpenImageIO

    if not _is_text(path):
        with _as_file(Path(path).read_bytes()) as copy:
            return channel_count(copy)
    image = OpenImageIO.ImageInput.open(str(path))
    if image is None:
        _reason(OpenImageIO)  # or it is printed at the end
        return 0
    channels = int(image.spec().nchannels)
    image.close()
    return channels


def is_baked(path: str | PathLike[str]) -> bool:
    """Tell whether an image is a texture that this program baked: by its text, else where none fits by its name."""
    name = Path(path)
    if name.suffix.lower() in EXTENSIONS_WITHOUT_TEXT:
        return name.stem.lower().endswith("_ao") and os.path.isfile(name)
    return os.path.isfile(name) and bool(read_text(name))


def _read(path: str | PathLike[str], kind: Literal["float", "uint8"]) -> NDArray[Any]:
    """Read an image as (height, width, channels) of a type of OpenImageIO."""
    import OpenImageIO

    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder, an image was expected")
    if not os.path.isfile(path):
        raise InputError(f"{path}: there is no such file, an image was expected; check the path")
    if not _is_text(path):
        with _as_file(Path(path).read_bytes(), ascii(str(path))) as copy:
            return _read(copy, kind)
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    buffer = OpenImageIO.ImageBuf(str(path), 0, 0, config)
    width, height = buffer.spec().width, buffer.spec().height
    if max(width, height) > MAX_SIDE:
        raise InputError(
            f"{path}: has {width} x {height} pixels, at most {MAX_SIDE:,} a side were expected; scale it down"
        )
    pixels: NDArray[Any] | None = None if buffer.has_error else buffer.get_pixels(kind)
    if pixels is None or buffer.has_error:
        raise InputError(f"{path}: cannot be read as an image ({_reason(buffer)}); check the file or convert it to PNG")
    return pixels


def decode_pixels(data: bytes, name: str) -> Float32Array:
    """Read an image, as `read_pixels` does, from the bytes of its file; error messages call it `name`."""
    with _as_file(data, name) as copy:
        return read_pixels(copy)


def decode_colors(data: bytes, name: str) -> UInt8Array:
    """Read an image, as `read_colors` does, from the bytes of its file; error messages call it `name`."""
    with _as_file(data, name) as copy:
        return read_colors(copy)


def read_text(path: str | PathLike[str]) -> str:
    """Return the text of this program that an image carries; empty where there is none, or no image."""
    import OpenImageIO

    if not _is_text(path):
        return decode_text(Path(path).read_bytes())
    image = OpenImageIO.ImageInput.open(str(path))
    if image is None:
        _reason(OpenImageIO)  # or it is printed at the end
        return ""
    try:
        spec = image.spec()
        named, described = spec.get_string_attribute(_TEXT), spec.get_string_attribute(_DESCRIPTION)
    except UnicodeDecodeError:  # it is none of ours, which are ASCII
        return ""
    finally:
        image.close()
    name, _, text = described.partition(" ")
    return str(named or (text if name == _TEXT else ""))


def decode_text(data: bytes) -> str:
    """Read the text of an image, as `read_text` does, from the bytes of its file."""
    with _as_file(data) as copy:
        return read_text(copy)


def _is_text(path: str | PathLike[str]) -> bool:
    """Tell whether a path is text, as OpenImageIO needs it: names of files may be bytes of any encoding."""
    return not any("\ud800" <= character <= "\udfff" for character in str(path))


@contextmanager
def _as_file(data: bytes, name: str = "image") -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "image.png"  # OpenImageIO goes by the content, not by the extension
        copy.write_bytes(data)
        try:
            yield copy
        except InputError as error:
            raise InputError(str(error).replace(str(copy), name)) from error


def _reason(source: Any) -> str:
    """Return OpenImageIO's message about an image, or about the last one, on one line."""
    try:
        text = source.geterror()
    except UnicodeDecodeError:  # it quotes bytes of a damaged file
        return "it is damaged"
    return textwrap.shorten(text, 160, placeholder=" ...") or "unknown reason"
