"""What a file is by its first bytes, where it is not what its name says, and why a reader failed: words for errors."""

import re
from dataclasses import dataclass
from pathlib import Path

from aoprecalc.errors import InputError
from aoprecalc.io.formats.base import MeshFormat

_START = 4096  # bytes that are looked at
_ROOT = re.compile(rb"<(?![?!])(?:\w+:)?([\w.-]+)")


@dataclass(frozen=True)
class _Kind:
    """Files that are no meshes: how they begin, what they are, and what to do."""

    start: re.Pattern[bytes]
    name: str
    advice: str


def _kind(start: bytes, name: str, advice: str) -> _Kind:
    return _Kind(re.compile(start, re.IGNORECASE | re.DOTALL), name, advice)


_SAVE_THE_FILE = "download the file itself, not the page that shows it"
_USE_THE_MESH = "name the mesh, not a picture of it"
_UNPACK = "unpack it"
_EXPORT = "export the model as glTF"
_KINDS = (
    _kind(rb"version https://git-lfs", "a Git LFS pointer", "run `git lfs pull` to fetch the mesh"),
    _kind(rb"\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)?<(!doctype html|html|head|body)\b", "an HTML page", _SAVE_THE_FILE),
    _kind(rb"\x89PNG", "a PNG picture", _USE_THE_MESH),
    _kind(rb"\xff\xd8\xff", "a JPEG picture", _USE_THE_MESH),
    _kind(rb"GIF8", "a GIF picture", _USE_THE_MESH),
    _kind(rb"RIFF....WEBP", "a WebP picture", _USE_THE_MESH),
    _kind(rb"II\*\0|MM\0\*", "a TIFF picture", _USE_THE_MESH),
    _kind(rb"v/1\x01|#\?RADIANCE", "a picture (EXR or HDR)", _USE_THE_MESH),
    _kind(rb"DDS ", "a DDS picture", _USE_THE_MESH),
    _kind(rb"%PDF-", "a PDF document", _EXPORT),
    _kind(rb"\x1f\x8b", "a gzip archive", _UNPACK),
    _kind(rb"7z\xbc\xaf\x27\x1c", "a 7z archive", _UNPACK),
    _kind(rb"Rar!\x1a\x07", "a RAR archive", _UNPACK),
    _kind(rb"\xfd7zXZ|BZh\d|\x28\xb5\x2f\xfd", "a compressed file (xz, bzip2 or Zstandard)", _UNPACK),
    _kind(rb".{257}ustar", "a tar archive", _UNPACK),
    _kind(rb"BLENDER", "a Blender file", "export it as glTF there"),
    _kind(rb"//Maya ASCII|FOR4.{4}CIMG", "a Maya scene", "export it as glTF or FBX there"),
    _kind(rb"\xd0\xcf\x11\xe0", "a 3ds Max scene or another OLE file", "export the model as glTF or FBX there"),
    _kind(rb"ISO-10303-21", "a STEP file of CAD", "export a mesh of it"),
    _kind(rb"#VRML", "a VRML file", _EXPORT),
    _kind(rb"Ogawa", "an Alembic file", _EXPORT),
    _kind(rb"\s*<(\?xml|svg|x3d)", "an XML document", _EXPORT),
    _kind(rb"\s*[{\[]\s*[\"{\[]", "a JSON document", _EXPORT),
)


def foreign_file(path: Path, data: bytes, expected: str, actual: MeshFormat | None) -> InputError | None:
    """Return the error for a file of another kind than the format `expected`; None where its kind is not known.

    actual   the format of a mesh that it looks like
    """
    if actual is not None:
        extensions = " or ".join(actual.extensions)
        return InputError(f"{path}: its content is {actual.name}, {expected} was expected; rename it to {extensions}")
    start = data[:_START]
    kind = next((kind for kind in _KINDS if kind.start.match(start)), None)
    if kind is None:
        return None
    root = _ROOT.search(start) if kind.name == "an XML document" else None
    of_what = f" of {root[1].decode('ascii', 'replace')[:40]}" if root else ""
    return InputError(f"{path}: is {kind.name}{of_what}, {expected} was expected; {kind.advice}")


def unreadable_file(path: Path, expected: str, error: Exception) -> InputError:
    """Return the error for a file in which a reader failed by another error than its own."""
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    if isinstance(error, KeyError):
        reason = f"{reason} is missing or unknown"
    return InputError(f"{path}: cannot be read as {expected} ({reason}); the file is damaged, export it again")
