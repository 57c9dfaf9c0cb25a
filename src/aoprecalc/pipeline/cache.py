"""A cache of results by their keys: a folder that batches share, also those of other machines.

    <folder>/v1/ab/abcd.../        an entry, under the key of its result
        result.json                digests of its files, and the summary
        files/                     its files
    <folder>/v1/new/               entries that are being written or removed

An entry appears whole, by being renamed, and never changes; so readers and writers need no lock. The modification time
of result.json is that of the last use.
"""

import json
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aoprecalc.api.reports import OMIT_NONE, Document, Report
from aoprecalc.errors import OutputError
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.pipeline.state import file_digest

_ABANDONED_AFTER = 24 * 3600  # seconds after which an entry in `new` has no writer any more
_USE_RESOLUTION = 60  # seconds: uses within it are noted once
_PRUNE_INTERVAL = 600  # seconds between two batches that prune, as that reads every entry

CACHE_TAG = "CACHEDIR.TAG"  # tells backup tools, and batches, to skip the folder (bford.info/cachedir)
_TAG = "Signature: 8a477f597d28d172789f06886806bc55\n# Results of aoprecalc, which can be made again.\n"


@dataclass(frozen=True)
class CacheUsage(Report):
    """The number of entries, which are results of assets, and their size in bytes."""

    entries: int = field(metadata={"key": "results"})
    bytes: int


@dataclass(frozen=True)
class CacheReport(Document):
    """What a cache holds, or what was removed from it.

    Attributes
    ----------
    folder : str
    holds, removed : CacheUsage or None
        The one that was asked for.
    """

    schema: int = field(default=SCHEMAS["cache"], kw_only=True)
    folder: str
    holds: CacheUsage | None = field(default=None, metadata=OMIT_NONE)
    removed: CacheUsage | None = field(default=None, metadata=OMIT_NONE)


class Cache:
    """A cache folder, which need not exist."""

    def __init__(self, folder: Path) -> None:
        """Name the folder."""
        self.folder = folder
        self._root = folder / "v1"

    def get(self, key: str, staging: Path) -> tuple[dict[str, Path], dict[str, Any]] | None:
        """Copy the files of an entry into a folder; return their copies by name, and the summary.

        None if there is no such entry, or it is being removed. A damaged entry is removed.
        """
        entry, files = self._entry(key), dict[str, Path]()
        if not os.path.exists(entry):
            return None
        try:
            document = json.loads((entry / "result.json").read_bytes())
            for name, digest in document["files"].items():
                if name != Path(name).name:
                    raise ValueError(f"{name}: is in another folder")
                files[name] = staging / f"{secrets.token_hex(6)}.{name}"
                shutil.copyfile(entry / "files" / name, files[name])
                if file_digest(files[name]) != digest:
                    raise ValueError(f"{name}: has another digest")
            summary: dict[str, Any] = document["summary"]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            for copy in files.values():
                copy.unlink(missing_ok=True)
            if isinstance(error, FileNotFoundError) or not isinstance(error, OSError):
                self._remove(entry)  # so that it is made again
            return None
        with suppress(OSError):  # a read-only cache is of use, too
            if (entry / "result.json").stat().st_mtime < time.time() - _USE_RESOLUTION:
                os.utime(entry / "result.json")
        return files, summary

    def put(self, key: str, files: Mapping[str, Path], summary: Mapping[str, Any]) -> bool:
        """Add an entry unless it is there; return whether it was added.

        files     name, without a folder -> file, which is copied
        Raises OutputError if the folder cannot be written.
        """
        entry = self._entry(key)
        if os.path.exists(entry):
            return False
        new = self._root / "new" / secrets.token_hex(12)
        try:
            (new / "files").mkdir(parents=True)
            if not (self.folder / CACHE_TAG).exists():
                (self.folder / CACHE_TAG).write_text(_TAG, encoding="ascii")
            for name, file in files.items():
                shutil.copyfile(file, new / "files" / name)
            digests = {name: file_digest(file) for name, file in sorted(files.items())}
            document = json.dumps({"files": digests, "summary": dict(summary)})
            (new / "result.json").write_text(document, encoding="utf-8")
            entry.parent.mkdir(parents=True, exist_ok=True)
            os.rename(new, entry)
        except OSError as error:
            shutil.rmtree(new, ignore_errors=True)
            if os.path.exists(entry):  # another writer has just added the same
                return False
            reason = error.strerror or str(error)
            raise OutputError(
                f"{self.folder}: the cache cannot be written ({reason}); choose another --cache"
            ) from error
        return True

    def usage(self) -> CacheUsage:
        """Count the entries and their bytes."""
        sizes = [size for _, _, size in self._entries()]
        return CacheUsage(len(sizes), sum(sizes))

    def prune(self, max_bytes: int | None = None, max_age: float | None = None) -> CacheUsage:
        """Remove entries unused for more than `max_age` seconds, then the longest unused beyond `max_bytes`.

        Returns what was removed.
        """
        self._remove_abandoned()
        now, kept, removed = time.time(), 0, []
        full = False
        for last_used, entry, size in sorted(self._entries(), reverse=True):
            full = full or (max_bytes is not None and kept + size > max_bytes)
            if full or (max_age is not None and last_used < now - max_age):
                removed += [size] if self._remove(entry) else []
            else:
                kept += size
        return CacheUsage(len(removed), sum(removed))

    def prune_sometimes(self, max_bytes: int) -> None:
        """Prune to `max_bytes`, unless a batch has done so within the last minutes."""
        marker = self._root / "pruned"
        with suppress(OSError):
            if not marker.exists() or marker.stat().st_mtime < time.time() - _PRUNE_INTERVAL:
                self.prune(max_bytes)
                marker.touch()

    def _entry(self, key: str) -> Path:
        return self._root / key[:2] / key

    def _entries(self) -> Iterator[tuple[float, Path, int]]:
        """Yield time of last use (0 if the entry is damaged), folder and bytes of each entry."""
        for entry in self._root.glob("[0-9a-f][0-9a-f]/*"):
            result = entry / "result.json"
            try:
                last_used = result.stat().st_mtime if result.exists() else 0.0
                size = sum(file.stat().st_size for file in entry.rglob("*") if file.is_file())
            except OSError:  # it is being removed
                continue
            yield last_used, entry, size

    def _remove(self, entry: Path) -> bool:
        """Remove an entry, by a rename and then file by file; return whether that was possible."""
        removed = self._root / "new" / secrets.token_hex(12)
        try:
            removed.parent.mkdir(exist_ok=True)
            os.rename(entry, removed)
        except OSError:
            return False
        shutil.rmtree(removed, ignore_errors=True)
        return True

    def _remove_abandoned(self) -> None:
        """Remove the unfinished entries of killed batches."""
        for entry in self._root.glob("new/*"):
            with suppress(OSError):
                if entry.stat().st_mtime < time.time() - _ABANDONED_AFTER:
                    shutil.rmtree(entry, ignore_errors=True)


def default_cache() -> Path:
    """Return the folder $AOPRECALC_CACHE, or `aoprecalc` in the user's cache folder."""
    if named := os.environ.get("AOPRECALC_CACHE"):
        return Path(named)
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or os.path.expanduser("~/.cache")
    if not os.path.isabs(home):  # a user without a home, as in some containers
        home = tempfile.gettempdir()
    return Path(home) / "aoprecalc"
