"""Results by what they were made from: a folder that batches share, also those of other machines.

    <folder>/v1/ab/abcd.../        an entry, under the key of its result
        result.json                what was made
        files/                     its files
    <folder>/v1/new/               what is being written, or was when a batch was killed

An entry appears whole, by being renamed, and is never changed; so writers and readers need no lock. The time of
result.json is that of the last use.
"""

import json
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aoprecalc.errors import OutputError
from aoprecalc.pipeline.state import file_digest

_ABANDONED = 24 * 3600  # seconds after which what is being written has no writer any more
_FINE = 60  # seconds: no need to note each use more finely
_SELDOM = 600  # seconds between two batches that prune, as that looks at every entry

CACHE_TAG = "CACHEDIR.TAG"  # tells backups, and batches, that a folder holds nothing of its own (bford.info/cachedir)
_TAG = "Signature: 8a477f597d28d172789f06886806bc55\n# Results of aoprecalc, which can be made again.\n"


@dataclass(frozen=True)
class CacheUsage:
    """What a cache holds, or what was removed from it: entries and bytes."""

    entries: int
    bytes: int


class Cache:
    """A cache folder, which need not exist."""

    def __init__(self, folder: Path) -> None:
        """Name the folder."""
        self.folder = folder
        self._home = folder / "v1"

    def get(self, key: str, staging: Path) -> tuple[dict[str, Path], dict[str, Any]] | None:
        """Copy the files of a result into a folder; return name -> copy, and what was said of them.

        None where there is no such entry, or it is going at this moment; a damaged one goes.
        """
        entry, files = self._entry(key), dict[str, Path]()
        if not os.path.exists(entry):
            return None
        try:
            said = json.loads((entry / "result.json").read_bytes())
            for name, digest in said["files"].items():
                if name != Path(name).name:
                    raise ValueError(f"{name}: is no file of its own folder")
                files[name] = staging / f"{secrets.token_hex(6)}.{name}"
                shutil.copyfile(entry / "files" / name, files[name])
                if file_digest(files[name]) != digest:
                    raise ValueError(f"{name}: holds something else")
            summary: dict[str, Any] = said["summary"]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            for copy in files.values():
                copy.unlink(missing_ok=True)
            if isinstance(error, FileNotFoundError) or not isinstance(error, OSError):
                self._remove(entry)  # it is made anew
            return None
        with suppress(OSError):  # a cache that cannot be written serves, too
            if (entry / "result.json").stat().st_mtime < time.time() - _FINE:
                os.utime(entry / "result.json")
        return files, summary

    def put(self, key: str, files: Mapping[str, Path], summary: Mapping[str, Any]) -> bool:
        """Add a result unless it is there; return whether it was added.

        files     name, without a folder -> file, which is copied
        Raises OutputError where the folder cannot be written.
        """
        entry = self._entry(key)
        if os.path.exists(entry):
            return False
        new = self._home / "new" / secrets.token_hex(12)
        try:
            (new / "files").mkdir(parents=True)
            if not (self.folder / CACHE_TAG).exists():
                (self.folder / CACHE_TAG).write_text(_TAG, encoding="ascii")
            for name, file in files.items():
                shutil.copyfile(file, new / "files" / name)
            digests = {name: file_digest(file) for name, file in sorted(files.items())}
            said = json.dumps({"files": digests, "summary": dict(summary)})
            (new / "result.json").write_text(said, encoding="utf-8")
            entry.parent.mkdir(parents=True, exist_ok=True)
            os.rename(new, entry)
        except OSError as error:
            shutil.rmtree(new, ignore_errors=True)
            if os.path.exists(entry):  # another writer was faster, with the same
                return False
            reason = error.strerror or str(error)
            raise OutputError(
                f"{self.folder}: the cache cannot be written ({reason}); choose another --cache"
            ) from error
        return True

    def usage(self) -> CacheUsage:
        """Count what it holds."""
        sizes = [size for _, _, size in self._entries()]
        return CacheUsage(len(sizes), sum(sizes))

    def prune(self, most: int | None = None, age: float | None = None) -> CacheUsage:
        """Remove what was last used more than `age` seconds ago, then the longest unused beyond `most` bytes.

        Returns what was removed.
        """
        self._sweep()
        now, kept, removed = time.time(), 0, []
        full = False
        for used, entry, size in sorted(self._entries(), reverse=True):
            full = full or (most is not None and kept + size > most)
            if full or (age is not None and used < now - age):
                removed += [size] if self._remove(entry) else []
            else:
                kept += size
        return CacheUsage(len(removed), sum(removed))

    def tidy(self, most: int) -> None:
        """Prune to `most` bytes, unless some batch has done so lately."""
        pruned = self._home / "pruned"
        with suppress(OSError):
            if not pruned.exists() or pruned.stat().st_mtime < time.time() - _SELDOM:
                self.prune(most)
                pruned.touch()

    def _entry(self, key: str) -> Path:
        return self._home / key[:2] / key

    def _entries(self) -> Iterator[tuple[float, Path, int]]:
        """Yield the time of its last use, the folder and the bytes of each entry; a damaged one was used long ago."""
        for entry in self._home.glob("[0-9a-f][0-9a-f]/*"):
            result = entry / "result.json"
            try:
                used = result.stat().st_mtime if result.exists() else 0.0
                size = sum(file.stat().st_size for file in entry.rglob("*") if file.is_file())
            except OSError:  # it is going at this moment
                continue
            yield used, entry, size

    def _remove(self, entry: Path) -> bool:
        """Remove an entry: at once for those who look for it, then its files; return whether that was possible."""
        going = self._home / "new" / secrets.token_hex(12)
        try:
            going.parent.mkdir(exist_ok=True)
            os.rename(entry, going)
        except OSError:
            return False
        shutil.rmtree(going, ignore_errors=True)
        return True

    def _sweep(self) -> None:
        """Remove what killed batches have left."""
        for left in self._home.glob("new/*"):
            with suppress(OSError):
                if left.stat().st_mtime < time.time() - _ABANDONED:
                    shutil.rmtree(left, ignore_errors=True)


def default_cache() -> Path:
    """Return the folder of $AOPRECALC_CACHE, else aoprecalc in the user's folder for caches."""
    if named := os.environ.get("AOPRECALC_CACHE"):
        return Path(named)
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or os.path.expanduser("~/.cache")
    if not os.path.isabs(home):  # a user without a home, as in some containers
        home = tempfile.gettempdir()
    return Path(home) / "aoprecalc"
