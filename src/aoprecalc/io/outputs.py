"""Output files that appear complete and together or not at all, their paths, and JSON documents."""

import errno
import hashlib
import json
import math
import os
import re
import secrets
from collections.abc import Collection, Iterable, Iterator
from contextlib import AbstractContextManager, suppress
from itertools import chain, count
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import quote

from aoprecalc.errors import ArgumentError, InputError, OutputError, UsageError, system_failure
from aoprecalc.system import path_from


class Outputs(AbstractContextManager["Outputs"]):
    """A set of files, written under temporary names and moved to their final paths at the end of the `with` block.

    If the block raises, the temporary files are removed and existing files at the final paths are unchanged.

        with Outputs() as outputs:
            write_something(outputs.path("build/rock_ao.png"))
    """

    def __init__(self, staging: str | os.PathLike[str] | None = None) -> None:
        """Start with no files.

        staging   a folder of the same file system for the temporary files; None: the folders of the final paths. With
                  one, the final folders need not exist, and the caller takes the files by `release`
        """
        self._staging = None if staging is None else Path(staging)
        self._requested: dict[Path, Path] = {}  # resolved path -> the path as the caller gave it
        self._pending: dict[Path, Path] = {}
        self._claimed: set[Path] = set()
        self._protected: set[Path] = set()
        self._folders: list[Path] = []

    @property
    def files(self) -> list[Path]:
        """The final paths of the files written so far, resolved, in the order of writing."""
        return list(self._pending)

    def protect(self, paths: Iterable[str | os.PathLike[str]]) -> None:
        """Refuse to overwrite these files, which belong to the input; raises UsageError where one is claimed."""
        self._protected.update(_real(path) for path in paths)
        for target in sorted(self._claimed & self._protected):
            raise _belongs_to_input(target)

    def folder(self, path: str | os.PathLike[str]) -> Path:
        """Create a folder and its parents where they are missing; they are removed again if the block fails.

        Raises OutputError where that is not possible.
        """
        folder = Path(path)
        missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
        try:
            for parent in reversed(missing):
                parent.mkdir()
                self._folders.append(parent)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(f"{folder}: the folder cannot be made ({reason}); choose another output") from error
        return folder

    def written(self, final: str | os.PathLike[str]) -> Path:
        """Return the path at which the content of `final` is now: its temporary path if it is one of these files."""
        return self._pending.get(_real(final), Path(final))

    @property
    def staged(self) -> bool:
        """Tell whether the files are staged, for a caller that may put other files beside them."""
        return self._staging is not None

    def candidates(self, file: Path) -> Iterator[Path]:
        """Yield a path, then numbered ones, without those of these files and those that are reserved."""
        numbered = (file.with_name(f"{file.stem}_{number}{file.suffix}") for number in count(1))
        return (
            name for name in chain([file], numbered) if self.written(name) == name and _real(name) not in self._claimed
        )

    def free_path(self, file: Path, data: bytes, own: Collection[Path] = ()) -> Path:
        """Return where a copy of these bytes may be written: `file`, or with a number if something else has that name.

        In a staging folder, where others write at the same time, it has a digest of the bytes instead.
        own   paths that other outputs will have
        """
        if self.staged:
            return file.with_name(f"{file.stem}-{hashlib.sha256(data).hexdigest()[:8]}{file.suffix}")
        return next(
            free
            for free in self.candidates(file)
            if free not in own and (not os.path.lexists(free) or (free.is_file() and free.read_bytes() == data))
        )

    def release(self) -> dict[Path, Path]:
        """Return {final path: temporary path}; the caller now moves or removes the files."""
        pending, self._pending = self._pending, {}
        return {self._requested[target]: temporary for target, temporary in pending.items()}

    def claim(self, final: str | os.PathLike[str]) -> None:
        """Check, before long work, that `final` can be written, and reserve it.

        Raises as `path` does; leaves no file.
        """
        if _real(final) in self._claimed:
            raise UsageError(f"{final}: two outputs have this name; give each its own")
        self.path(final).unlink()
        del self._pending[_real(final)]
        self._claimed.add(_real(final))

    def path(self, final: str | os.PathLike[str]) -> Path:
        """Return the temporary path (same extension) to which the caller writes the content of `final`.

        Raises OutputError where the folder is missing or not writable, and where `final` exists but is not a regular
        file; UsageError where it is one of the input's own files or was requested before.
        """
        target = _real(final)
        if target in self._pending:
            raise UsageError(f"{final}: two outputs have this name; give each its own")
        if target in self._protected:
            raise _belongs_to_input(final)
        _check_name(target)
        if target.exists() and not target.is_file():
            kind = "a folder" if target.is_dir() else "no regular file"
            raise OutputError(f"{final}: is {kind}, a file name was expected; choose another output")
        if self._staging is None and not target.parent.is_dir():
            raise OutputError(f"{final}: there is no folder {Path(final).parent}; create it or choose another output")
        temporary = (self._staging or target.parent) / f".{secrets.token_hex(6)}{target.suffix}"
        try:
            temporary.touch(exist_ok=False)
        except OSError as error:
            raise OutputError(
                f"{final}: cannot write there ({error.strerror}); choose another output or change its permissions"
            ) from error
        self._pending[target], self._requested[target] = temporary, Path(final)
        return temporary

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Move every file to its final path, or remove them all if the block failed."""
        try:
            if kind is None:
                self._commit()
                self._folders.clear()
        finally:
            for temporary in self._pending.values():
                with suppress(OSError):
                    temporary.unlink(missing_ok=True)
            for folder in reversed(self._folders):
                with suppress(OSError):
                    folder.rmdir()

    def _commit(self) -> None:
        for target, temporary in self._pending.items():
            try:
                os.replace(temporary, target)
            except OSError as error:
                raise OutputError(f"{target}: cannot be replaced ({error.strerror}); choose another output") from error


def _check_name(target: Path) -> None:
    """Raise OutputError where no file may have this name as it is too long."""
    try:
        os.lstat(target)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise OutputError(system_failure(error, "choose another output")) from error


def _belongs_to_input(path: str | os.PathLike[str]) -> UsageError:
    return UsageError(f"{path}: belongs to the input itself; choose another name or folder for the output")


def _real(path: str | os.PathLike[str]) -> Path:
    """Return the absolute path with links resolved."""
    return Path(os.path.realpath(path))


# The paths that options name.


def output_path(wanted: str | PathLike[str] | None, default: str | Path, argument: str = "output") -> Path:
    """Return the path of an output file; raises ArgumentError where `wanted` is no path.

    wanted    as the user gave it: a file, or a folder (existing, or ending in a slash) for a file with the name of the
              default; None: the default
    default   a path, relative to the current folder
    argument  name of the argument that `wanted` is
    """
    if wanted is None:
        return Path(default)
    if not isinstance(wanted, str | PathLike) or not os.fspath(wanted) or "\0" in os.fspath(wanted):
        found = repr(wanted) if isinstance(wanted, str) else f"of type {type(wanted).__name__}"
        raise ArgumentError(argument, f"is {found}, the path of a file or folder was expected")
    path = Path(wanted)
    return path / Path(default).name if path.is_dir() or _ends_in_slash(wanted) else path


def texture_stem(stem: str) -> str:
    """Return the stem of the texture beside a mesh of a given stem: with _ao at its end, once.

    So that the texture never has the name of a picture that the mesh itself uses, often <stem>.png.
    """
    return stem if stem.lower().endswith("_ao") else f"{stem}_ao"


def claim_output(outputs: Outputs, wanted: str | PathLike[str] | None, path: Path) -> None:
    """Check, before long work, that an output file can be written, and reserve it; see Outputs.claim.

    wanted   as the user gave it to `output_path`; if it ends in a slash, the folder is created
    path     what `output_path` returned
    """
    if wanted is not None and _ends_in_slash(wanted):
        outputs.folder(path.parent)
    outputs.claim(path)


def _ends_in_slash(wanted: str | PathLike[str]) -> bool:
    return os.fspath(wanted).endswith(("/", os.sep))


# References from one output file to another.


def relative_path(target: Path, file: Path) -> str:
    """Return the relative path of `target` from the folder of `file`, with forward slashes."""
    return path_from(target, file.parent)


def relative_uri(target: Path, file: Path) -> str:
    """Return the relative path of `target` from the folder of `file` as a URI reference."""
    return quote(os.fsencode(relative_path(target, file)))


# JSON documents.

# The version of each kind of document, its member "schema". The JSON Schemas are in the package's folder `schemas`:
#     importlib.resources.files("aoprecalc") / "schemas" / "bake.schema.json"
SCHEMAS = {
    "bake": 1,
    "batch": 1,
    "batch record": 2,
    "cache": 1,
    "compare": 1,
    "doctor": 1,
    "preview": 1,
    "report": 1,
    "spheres": 1,
    "verify": 1,
}


def json_text(document: dict[str, Any]) -> str:
    """Return a document as indented JSON; raises ValueError for numbers not finite.

    Control characters are escaped, and so are bytes of names that are no text (surrogates), which UTF-8 cannot hold.
    """
    text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    return re.sub(r"[\x7f-\x9f\ud800-\udfff]", lambda found: f"\\u{ord(found[0]):04x}", text)


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a document as indented JSON; raises OutputError where the file cannot be written."""
    try:
        path.write_text(json_text(document), encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error


def read_json_object(path: Path) -> dict[str, Any]:
    """Read a JSON object of finite numbers; raises InputError where the file is missing or holds something else."""
    try:
        document = json.loads(path.read_bytes(), parse_float=_finite, parse_constant=_finite)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), a JSON file was expected") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({' '.join(str(error).split())[:120]}); write it again") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: holds no JSON object; a report or a sphere set was expected")
    return document


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is not a finite number")
    return number
