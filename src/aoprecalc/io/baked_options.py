"""What travels with a baked texture: the options that define its values, its certificate, what its mesh had, 1 - AO.

The text of an image (see `images.py`) has it as JSON, in ASCII:

    {"schema": 1, "only": ["roof"], ..., "two_sided": true, "ground": true, "up": "y", ..., "triangles": 1234}

Options that are None or name nothing are left out. With `--max-error` there is the member "certificate", an object with
the fields of `Certificate`.

An image that holds 1 - AO has the member `"inverted": true`, too; who reads it gets AO: see `occlusion_pixels`. Where
options name files, the member `"files"` has the beginning of the SHA-256 of each, by option.

glTF's occlusionTexture has the options and the certificate in its `extras`, as the member "aoprecalc". Neither has
times or names of machines, and of the paths of files they have the names only. What is read is not trusted: its size is
bounded, and it is checked as options of the command line.
"""

import hashlib
import json
import os
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from aoprecalc.errors import ArgumentError
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.images import MAX_TEXT
from aoprecalc.options import ValueOptions
from aoprecalc.options.fields import named_files, with_files
from aoprecalc.types import CONFIDENCE, Certificate, Float32Array

OPTIONS_SCHEMA = 1  # version of the JSON
EXTRAS = "aoprecalc"  # the member of glTF's `extras`
_TRIANGLES, _INVERTED, _FILES, _CERTIFICATE = "triangles", "inverted", "files", "certificate"
_DIGITS = 16  # of a SHA-256, in hexadecimal: enough to tell files of one name apart


def options_document(options: ValueOptions | None, certificate: Certificate | None = None) -> dict[str, Any] | None:
    """Return the JSON object of some options, and a certificate if there is one.

    None for no options, and where its text would be longer than MAX_TEXT.
    """
    if options is None:
        return None
    values = asdict(with_files(options, os.path.basename))
    document = {"schema": OPTIONS_SCHEMA} | {name: value for name, value in values.items() if value not in (None, ())}
    if certificate is not None and len(_json(document)) <= MAX_TEXT - 300:
        document[_CERTIFICATE] = asdict(certificate)
    return document if len(_json(document)) <= MAX_TEXT - 60 else None  # with room for the other members


def bake_text(
    options: ValueOptions | None, triangles: int, certificate: Certificate | None = None, *, inverted: bool = False
) -> str:
    """Return the text for the texture of a bake of so many triangles; empty where there is no document.

    inverted   the image holds 1 - AO
    """
    document = options_document(options, certificate)
    if document is None:
        return ""
    document |= {_TRIANGLES: triangles, **({_INVERTED: True} if inverted else {})}
    digests = {name: list(map(file_digest, paths)) for name, paths in named_files(options).items()}
    text = _json(document | ({_FILES: digests} if digests else {}))
    return text if len(text) <= MAX_TEXT else _json(document)


def read_options(found: object) -> ValueOptions:
    """Return the options that a text or a JSON object stands for; raises ValueError where it stands for none."""
    try:
        text = found if isinstance(found, str) else _json(found)
        if len(text) > MAX_TEXT:
            raise ValueError(f"it is longer than {MAX_TEXT} characters")
        document = json.loads(text)
        schema = document.pop("schema", None) if isinstance(document, dict) else None
        if schema != OPTIONS_SCHEMA:
            raise ValueError(f"its schema is {str(schema)[:20]!a}, {OPTIONS_SCHEMA} was expected")
        return msgspec.convert(document, ValueOptions)
    except json.JSONDecodeError as error:
        raise ValueError("it is not JSON") from error
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    except (msgspec.ValidationError, ArgumentError) as error:
        raise ValueError(f"{str(error)[:120]!a}") from error


def baked_options(image: ImageSource, extras: object = None) -> tuple[ValueOptions | None, tuple[str, ...]]:
    """Return the options with which an image was baked, and warnings; None where nothing says them.

    extras   what a mesh's file says of them, as JSON, for an image that carries no text itself; None if nothing
    """
    found = image.text() or extras
    if found is None:
        return None, ()
    try:
        return read_options(found), ()
    except ValueError as error:
        return None, (f"{image.name}: the options of its bake cannot be read ({error}); they are not used",)


def baked_triangles(image: ImageSource) -> int | None:
    """Return how many triangles the mesh had for which an image was baked; None where the image does not say."""
    count = _member(image, _TRIANGLES)
    return count if isinstance(count, int) else None


def baked_files(image: ImageSource) -> dict[str, tuple[str, ...]]:
    """Return the digests of the files that each option of the bake named, see `file_digest`; empty where none is told.

    A file that was not there when the image was written has an empty one.
    """
    found = _member(image, _FILES)
    lists = found.items() if isinstance(found, dict) else ()
    return {name: tuple(map(str, digests)) for name, digests in lists if isinstance(digests, list)}


def file_digest(path: str) -> str:
    """Return what tells a file from others of its name: the beginning of its SHA-256; empty where it cannot be read."""
    try:
        stat = os.stat(path)
        return _digest(os.path.abspath(path), stat.st_size, stat.st_mtime_ns)
    except OSError:
        return ""


@lru_cache
def _digest(path: str, size: int, time: int) -> str:
    """Return the digest of a file of a size and a time, which tell whether it has changed since the last call."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:_DIGITS]


def baked_certificate(image: ImageSource, extras: object = None) -> Certificate | None:
    """Return the certificate that came with an image; None where there is none, or one that cannot be read.

    extras   see `baked_options`
    """
    found = image.text() or extras
    try:
        read_options(found)
        document: Any = json.loads(found) if isinstance(found, str) else found
        certificate = msgspec.convert(document.get(_CERTIFICATE), Certificate)
    except ValueError:
        return None
    known = 0.001 <= certificate.max_error <= 1 and certificate.confidence == CONFIDENCE
    return certificate if known and 0 <= certificate.bound <= 1 else None


def occlusion_pixels(image: ImageSource) -> Float32Array:
    """Return the pixels of an image of ambient occlusion, (height, width, channels) float32, as AO: 1 is open.

    Raises InputError where it cannot be read.
    """
    pixels = image.pixels()
    return 1 - pixels if _member(image, _INVERTED) is True else pixels


def occlusion_values(image: ImageSource) -> Float32Array:
    """Return the first channel of `occlusion_pixels`, (height, width) float32."""
    return np.ascontiguousarray(occlusion_pixels(image)[:, :, 0])


def _member(image: ImageSource, name: str) -> object:
    """Return a member of the text of an image; None where it has none, or one that cannot be read."""
    text = image.text()
    try:
        read_options(text)
    except ValueError:
        return None
    return json.loads(text).get(name)


def _json(document: object) -> str:
    return json.dumps(document, separators=(",", ":"))
