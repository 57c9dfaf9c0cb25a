"""The files that a mesh refers to, found by their names as programs of many systems write them; images; text as UTF-8.

The rules are those of the importers that read most files: tinyobjloader (several libraries in one line), Blender
(backslashes, quotes, the name alone where its folders are missing) and Assimp (upper and lower case).
"""

import codecs
import errno
import math
import os
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Self
from urllib.parse import unquote

from aoprecalc.errors import InputError
from aoprecalc.io.images import (
    channel_count,
    decode_colors,
    decode_pixels,
    decode_text,
    opacity_of,
    read_colors,
    read_pixels,
    read_text,
)
from aoprecalc.io.outputs import Outputs, relative_path
from aoprecalc.types import Float32Array, UInt8Array

# Longest first: the mark of UTF-32 begins with that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_PROBE = 256  # bytes of a text without a mark that show whether it is UTF-16
# Of names that are not UTF-8: Western, Japanese, Chinese, Russian.
_OLD_ENCODINGS = ("cp1252", "cp932", "gbk", "cp1251")
_MAX_NAME = 4096  # characters

# Windows asks the server that such a name begins with, or opens a device.
_SERVER = re.compile(r"[/\\](\?\?)?[/\\]")
_QUOTES = "\"'"
UDIM = "<UDIM>"  # stands for the number of a tile in the name of a texture of several images


def read_file(path: Path) -> bytes:
    """Return the bytes of a file that a mesh refers to.

    Raises OSError where it cannot be read, also for devices and pipes, which may have no end.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))
    return path.read_bytes()


def text_as_utf8(data: bytes) -> bytes:
    """Return the bytes of a text in UTF-8 without a byte order mark; anything else, binary files too, as it is.

    A mark tells UTF-16 and UTF-32; without one, zeros in every other byte of the beginning tell UTF-16.
    """
    encoding = next((encoding for mark, encoding in _MARKS if data.startswith(mark)), None)
    if encoding == "utf-8":
        unmarked = data.removeprefix(codecs.BOM_UTF8)
        return data if b"\0" in unmarked and not unmarked.startswith(b"ply") else unmarked
    if encoding is None:
        even, odd = data[:_PROBE:2], data[1:_PROBE:2]
        if odd and not any(odd) and all(even):
            encoding = "utf-16-le"
        elif odd and not any(even) and all(odd):
            encoding = "utf-16-be"
        else:
            return data
    text = data.decode(encoding, "replace").removeprefix("\ufeff")
    return data if "\0" in text else text.encode()


def read_utf8(path: Path) -> str:
    """Return the text of a file, with surrogates for bytes that are not UTF-8; raises OSError as `read_file` does."""
    return text_as_utf8(read_file(path)).decode("utf-8", "surrogateescape")


def are_numbers(words: Iterable[str | bytes]) -> bool:
    """Tell whether all words of a text are finite numbers."""
    try:
        return all(math.isfinite(float(word)) for word in words)
    except ValueError:
        return False


def file_beside(folder: Path, name: str) -> Path | None:
    """Return the file that a mesh in `folder` names by a relative or absolute path; None for names of servers.

    Both slashes count on every system, so that a mesh has the same files everywhere.
    """
    return None if _SERVER.match(name) or "\0" in name else folder / name


class FileSearch:
    """Finds files by the names that a mesh, or its material library, gives them.

    A name counts as it is, then with backslashes as slashes, without quotes or a comment behind it, with %20 for
    blanks, in an older encoding than UTF-8; then in any case of its letters; and then without its folders.
    """

    def __init__(self, *folders: Path) -> None:
        """Look into these folders, in their order."""
        self._folders = tuple(dict.fromkeys(folders))
        self._listings: dict[str, dict[str, str]] = {}

    def find(self, name: str) -> Path | None:
        """Return the existing file that a name means; None where there is none, and for names of servers."""
        if not name or len(name) > _MAX_NAME or _SERVER.match(name.lstrip(_QUOTES)):
            return None
        spellings = list(dict.fromkeys(_spellings(name)))
        bare = [PurePosixPath(spelling).name for spelling in spellings if "/" in spelling]
        for names in (spellings, bare):
            for look_up in (_existing, self._any_case):
                found = (look_up(folder, spelling) for spelling in names for folder in self._folders)
                if (file := next(filter(None, found), None)) is not None:
                    return file
        return None

    def place(self, name: str) -> Path | None:
        """Return the file that a name means or, where there is none, its place; None for names of servers."""
        return self.find(name) or file_beside(self._folders[0], name.strip().strip(_QUOTES).replace("\\", "/"))

    def split(self, text: str, extension: str) -> list[str]:
        """Return the names in a text: all of it where that is a file, else those that blanks part.

        extension   of the files; names may have blanks before it
        """
        if self.find(text):
            return [text]
        if len(text) > _MAX_NAME:
            return text.split()
        pattern = rf"\"[^\"]+\"|\S[^\"]*?{re.escape(extension)}(?=\s|$)|\S+"
        names = []
        for name in re.findall(pattern, text, re.IGNORECASE):
            words = [word for word in name.split() if self.find(word)]
            names += [name] if self.find(name) or not words else words
        return names

    def _any_case(self, folder: Path, name: str) -> Path | None:
        """Return the file of a relative path, whatever the case of its letters and the form of its accents."""
        parts = PurePosixPath(name).parts
        if not parts or parts[0].startswith("/") or ":" in parts[0]:  # no folder of ours
            return None
        file = folder
        for part in parts:
            if part == ".." or os.path.lexists(file / part):
                file /= part
            elif (known := self._listing(file).get(_folded(part))) is not None:
                file /= known
            else:
                return None
        return file if os.path.isfile(file) else None

    def _listing(self, folder: Path) -> dict[str, str]:
        key = str(folder)
        if key not in self._listings:
            names: list[str] = []
            with suppress(OSError, ValueError):
                names = sorted(os.listdir(folder), reverse=True)  # the first name of several alike is kept
            self._listings[key] = {_folded(name): name for name in names}
        return self._listings[key]


def _existing(folder: Path, name: str) -> Path | None:
    file = file_beside(folder, name)
    return file if file is not None and os.path.isfile(file) else None


def _spellings(name: str) -> Iterator[str]:
    """Yield what a name may mean, the likeliest first."""
    plain = name.strip()
    unquoted = plain.strip(_QUOTES)
    for spelling in (plain, unquoted, re.split(r"\s#", unquoted)[0].rstrip().strip(_QUOTES)):
        yield spelling
        yield (slashed := spelling.replace("\\", "/"))
        if "%" in slashed:
            yield unquote(slashed)
        if not slashed.isascii():
            raw = spelling.encode("utf-8", "surrogateescape")
            for encoding in _OLD_ENCODINGS:
                with suppress(UnicodeDecodeError):
                    yield raw.decode(encoding).replace("\\", "/")


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


# Images.


class TextureCopies:
    """Names the textures of a source for a mesh that is written: by their place, or as copies beside it.

    Copies where the mesh is written to another folder, which does not have them in it: that can be moved then, and
    programs that leave no folder (trimesh) find them. Only images are copied, for a mesh may name any file.
    """

    def __init__(self, outputs: Outputs, path: Path, source: Path) -> None:
        """Start without copies; `path` is that of the written mesh, `source` that of the mesh with the textures."""
        self._outputs, self._path = outputs, path
        self._stay = os.path.realpath(path.parent) == os.path.realpath(source.parent)
        self._names: dict[Path, str] = {}

    def name(self, file: Path) -> str:
        """Return the name of a texture as the written mesh states it."""
        if file not in self._names:
            copied = self._is_copied([file])
            self._names[file] = self._copy(file) if copied else relative_path(file, self._path)
        return self._names[file]

    def tiles(self, pattern: Path, tiles: dict[str, Path]) -> str:
        """Return the name of a texture of several images, with <UDIM> in it as in `pattern`.

        tiles   the images, by the number in the place of <UDIM>
        """
        if pattern not in self._names:
            copied = self._is_copied(tiles.values())
            self._names[pattern] = self._copy_tiles(pattern, tiles) if copied else relative_path(pattern, self._path)
        return self._names[pattern]

    def _is_copied(self, files: Collection[Path]) -> bool:
        folder = os.path.realpath(self._path.parent)
        outside = (not Path(os.path.realpath(file)).is_relative_to(folder) for file in files)
        return not self._stay and all(outside) and all(map(channel_count, files))

    def _copy_tiles(self, pattern: Path, tiles: dict[str, Path]) -> str:
        contents = {number: read_file(tile) for number, tile in tiles.items()}

        def copies(name: Path) -> dict[Path, bytes]:
            return {name.with_name(name.name.replace(UDIM, number)): data for number, data in contents.items()}

        place = self._path.with_name(pattern.name)
        if self._outputs.staged:
            place = self._outputs.free_path(place, b"".join(contents.values()))
        else:
            free = self._outputs.free_path
            names = self._outputs.candidates(place)
            place = next(name for name in names if all(free(file, data) == file for file, data in copies(name).items()))
        for file, data in copies(place).items():
            self._outputs.path(file).write_bytes(data)
        return place.name

    def _copy(self, file: Path) -> str:
        data = read_file(file)
        copy = self._outputs.free_path(self._path.with_name(file.name), data, (self._path,))
        self._outputs.path(copy).write_bytes(data)
        return copy.name


@dataclass(frozen=True)
class ImageSource:
    """An image that a mesh file refers to.

    name   for messages
    path   its file; None for an image embedded in the mesh's file
    data   the bytes of an embedded image
    """

    name: str
    path: Path | None = None
    data: bytes = field(default=b"", repr=False)

    @classmethod
    def of(cls, path: Path) -> Self:
        """Return the image of a file."""
        return cls(str(path), path)

    @property
    def file_name(self) -> str:
        """The name of its file, or of one that could hold it."""
        return PurePosixPath(self.name.replace("\\", "/").rstrip("]")).name if self.path is None else self.path.name

    def pixels(self) -> Float32Array:
        """Return the stored values, (height, width, channels) float32; raises InputError where it cannot be read."""
        return decode_pixels(self.data, self.name) if self.path is None else read_pixels(self.path)

    def content(self) -> bytes:
        """Return the bytes of its file; raises OSError where it cannot be read."""
        return self.data if self.path is None else read_file(self.path)

    def opacity(self, channel: str = "") -> Float32Array | None:
        """Return one channel as an opacity, see `opacity_of`; raises InputError where the image cannot be read."""
        if channel == "alpha" and self.path is not None and channel_count(self.path) in (1, 3):
            return None
        return opacity_of(self.pixels(), channel)

    def colors(self) -> UInt8Array:
        """Return the colours as stored, (height, width, 3) uint8; raises InputError where it cannot be read."""
        return decode_colors(self.data, self.name) if self.path is None else read_colors(self.path)

    def text(self) -> str:
        """Return the text of this program that the image carries; empty where there is none."""
        return decode_text(self.data) if self.path is None else read_text(self.path)


def same_file(first: Path | None, second: Path | None) -> bool:
    """Tell whether two paths, if any, are those of one file, existing or not."""
    return first is not None and second is not None and os.path.realpath(first) == os.path.realpath(second)


class ColorImages:
    """The images of base colours, each decoded once.

    warnings   for the user, about images that cannot be read
    """

    def __init__(self) -> None:
        """Start without images."""
        self._decoded: dict[ImageSource, UInt8Array | None] = {}
        self.warnings: list[str] = []

    def get(self, image: ImageSource) -> UInt8Array | None:
        """Return the colours of an image, (height, width, 3) uint8; None, and a warning, where it cannot be read."""
        if image not in self._decoded:
            try:
                self._decoded[image] = image.colors()
            except InputError as error:
                self._decoded[image] = None
                self.warn(error)
        return self._decoded[image]

    def warn(self, error: InputError) -> None:
        """Warn that a texture is missing or damaged."""
        self.warnings.append(f"a base colour is drawn without its texture: {error}")
