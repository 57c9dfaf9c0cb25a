"""The results of a batch: those in its output folder, and the cache that batches share.

The cache is a folder of results by their keys, which batches of several machines may use:

    <folder>/v1/ab/abcd.../        an entry, under the key of its result
        result.json                digests of its files, and the summary
        files/                     its files
    <folder>/v1/new/               entries that are being written or removed

An entry appears whole, by being renamed, and never changes; so readers and writers need no lock. The modification time
of result.json is that of the last use.
"""

import errno
import json
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from aoprecalc.api.documents import OMIT_NONE, Document, Report
from aoprecalc.errors import OutputError
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.jobs import Asset, Failure, Job, Outcome, Success
from aoprecalc.pipeline.report import AssetResult, BatchProgress, Status
from aoprecalc.pipeline.state import (
    AssetRecord,
    FileStamp,
    InputFiles,
    StateFolder,
    file_digest,
    result_key,
    spec_key,
)

_ABANDONED_AFTER = 24 * 3600  # seconds after which an entry in `new` has no writer any more
_USUAL_TEXELS = 1024**2  # of a texture whose size the bake chooses
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
                files[name] = staging / f"{secrets.token_hex(6)}{Path(name).suffix}"
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


# The output folder.


@dataclass(frozen=True, eq=False)
class PendingAsset:
    """An asset that has to be made.

    spec_key, result_key   see the functions of that name
    inputs                 the files that it is made from
    previous               how it was made the last time; None: never
    """

    asset: Asset
    spec_key: str
    result_key: str
    inputs: InputFiles
    previous: AssetRecord | None

    def cost(self) -> tuple[int, int]:
        """Return a rough measure of how long it takes: texels times directions of the bake, bytes of the inputs."""
        bake = self.asset.spec.bake
        samples = 0 if bake is None else (bake.width * bake.height or _USUAL_TEXELS) * bake.direction_count
        return samples, sum(stamp.size for stamp in self.inputs.files.values())


class ResultStore(AbstractContextManager["ResultStore"]):
    """The output folder of a batch and its cache; no other batch writes to the folder during the `with` block."""

    def __init__(self, output: Path, cache: Cache | None, options: BatchOptions, progress: BatchProgress) -> None:
        """Name both folders."""
        self._output, self._cache, self._options, self._progress = output, cache, options, progress
        self._state = StateFolder(output)
        self._stack = ExitStack()
        self._cache_has_grown = False

    def __enter__(self) -> "ResultStore":
        """Lock the output folder; raises OutputError if it cannot be written."""
        self._stack.enter_context(self._state.locked())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Unlock the output folder, and prune the cache if it has grown."""
        self._stack.close()
        if self._cache is not None and self._cache_has_grown:
            self._cache.prune_sometimes(self._options.cache_size)

    def find(self, asset: Asset) -> AssetResult | PendingAsset:
        """Return the result of an asset that is up to date or cached, otherwise what has to be made."""
        try:
            return self._find(asset)
        except OSError as error:
            return _failed(asset, Failure("error", f"{asset.mesh}: cannot be read ({error}); check the disk"))

    def _find(self, asset: Asset) -> AssetResult | PendingAsset:
        key, record = spec_key(asset, self._output), self._state.get(asset.name)
        current = None
        if record is not None and record.spec_key == key and not self._options.force and self._is_intact(asset, record):
            current = record
        if current is not None and current.inputs.match(asset.mesh):
            return AssetResult(asset, "unchanged", tuple(current.outputs), current.summary)
        inputs = InputFiles.of(asset.mesh, asset.spec.files)
        if current is not None and current.inputs.same_contents(inputs):
            with suppress(OSError):  # without the new times, the next batch reads the files again
                self._state.put(asset.name, AssetRecord(key, inputs, current.outputs, current.summary))
            return AssetResult(asset, "unchanged", tuple(current.outputs), current.summary)
        pending = PendingAsset(asset, key, result_key(key, inputs), inputs, record)
        if self._cache is not None and not self._options.force:
            cached = self._cache.get(pending.result_key, self._state.staging)
            if cached is not None:
                return self._move_into_place(pending, "cached", *cached, seconds=0.0)
        return pending

    def job(self, pending: PendingAsset, threads: int) -> Job:
        """Return the job that makes an asset; `threads`: for a spec that does not say."""
        asset, folder = pending.asset, self._folder(pending.asset)
        staging = self._state.staging / secrets.token_hex(8)
        written = {os.path.abspath(file): str(file) for file in asset.spec.files}
        return Job(
            name=asset.name,
            mesh=Path(os.path.abspath(asset.mesh)),
            label=str(asset.mesh),
            folder=Path(os.path.abspath(folder)),
            stem=asset.stem,
            staging=Path(os.path.abspath(staging)),
            spec=asset.spec.with_threads(threads).with_files(os.path.abspath),
            scheduler=self._options.scheduler if self._options.split else None,
            files=tuple(written.values()),
        )

    def accept(self, pending: PendingAsset, job: Job, outcome: Outcome) -> AssetResult:
        """Move the files of a successful job into place and into the cache; return the asset's result."""
        try:
            if isinstance(outcome, Failure):
                return _failed(pending.asset, outcome)
            if not InputFiles.of(pending.asset.mesh, pending.asset.spec.files).same_contents(pending.inputs):
                message = f"{job.label}: was changed while it was worked on; run the batch again"
                return _failed(pending.asset, Failure("error", message, seconds=outcome.seconds))
            self._add_to_cache(pending, outcome)
            return self._move_into_place(pending, "made", outcome.files, outcome.summary, outcome.seconds)
        finally:
            shutil.rmtree(job.staging, ignore_errors=True)

    def prune(self, assets: Collection[str]) -> None:
        """Remove the unchanged outputs of recorded assets that are not among these names."""
        for name in sorted(set(self._state.names()) - set(assets)):
            if (record := self._state.get(name)) is not None:
                self._state.drop(name)
                self._remove(record.outputs, self._state.asset_folder(name))
                self._progress.note(f"removed the outputs of {name}, which is not among the assets any more")

    def _remove(self, outputs: Mapping[str, FileStamp], folder: Path) -> None:
        """Remove outputs that belong to no asset now and that nobody has changed, and their folder if it is empty."""
        for name, stamp in outputs.items():
            if not self._state.is_output(folder / name) and FileStamp.of(folder / name).digest == stamp.digest:
                (folder / name).unlink(missing_ok=True)
        with suppress(OSError):
            folder.rmdir()

    def _add_to_cache(self, pending: PendingAsset, success: Success) -> None:
        """Add a result to the cache; if that fails, the batch goes on without a cache."""
        if self._cache is None:
            return
        try:
            self._cache_has_grown |= self._cache.put(pending.result_key, success.files, success.summary)
        except OutputError as error:
            self._progress.warn(f"{error}; the batch goes on without it")
            self._cache = None

    def _move_into_place(
        self, pending: PendingAsset, status: Status, files: dict[str, Path], summary: dict[str, Any], seconds: float
    ) -> AssetResult:
        """Move files (final name -> file) from the staging folder to the asset's folder, and record them."""
        asset, folder = pending.asset, self._folder(pending.asset)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name in files:  # checked beforehand, so that all files are moved or none
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(folder / name))
            for name, file in files.items():
                os.replace(file, folder / name)
            stamps = {name: FileStamp.of(folder / name, is_final=True) for name in sorted(files)}
            self._state.put(asset.name, AssetRecord(pending.spec_key, pending.inputs, stamps, summary))
            if pending.previous is not None and pending.previous.outputs.keys() - files.keys():
                self._remove(pending.previous.outputs, folder)
        except OSError as error:
            path = error.filename2 or error.filename or folder
            message = f"{path}: cannot be written ({error.strerror or error}); choose another output"
            return _failed(asset, Failure("error", message, seconds=seconds))
        return AssetResult(asset, status, tuple(stamps), summary, seconds=seconds)

    def _is_intact(self, asset: Asset, record: AssetRecord) -> bool:
        """Tell whether all outputs of a record are as they were written."""
        folder = self._folder(asset)
        return all(
            stamp.matches(folder / name) or FileStamp.of(folder / name).digest == stamp.digest
            for name, stamp in record.outputs.items()
        )

    def _folder(self, asset: Asset) -> Path:
        return self._state.asset_folder(asset.name)


def _failed(asset: Asset, failure: Failure) -> AssetResult:
    status: Status = "stopped" if failure.kind == "stopped" else "failed"
    return AssetResult(asset, status, failure=failure, seconds=failure.seconds)
