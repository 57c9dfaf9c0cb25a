"""Where results are kept and looked for: the output folder with its records, and the cache."""

import errno
import os
import secrets
import shutil
from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from aoprecalc.errors import OutputError
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.cache import Cache
from aoprecalc.pipeline.jobs import Asset, Failure, Job, Outcome, Success
from aoprecalc.pipeline.report import AssetResult, BatchProgress, Status
from aoprecalc.pipeline.state import AssetRecord, FileStamp, InputFiles, StateFolder, result_key, spec_key


@dataclass(frozen=True, eq=False)
class PendingAsset:
    """An asset that has to be made.

    order, key   digests of its order and of its result
    inputs       what it is made from
    before       how it was made the last time, where it was
    """

    asset: Asset
    spec_key: str
    key: str
    inputs: InputFiles
    before: AssetRecord | None

    def weight(self) -> tuple[int, int]:
        """Return what tells roughly how long it takes: samples of its bake, bytes of its files."""
        bake = self.asset.spec.bake
        samples = 0 if bake is None else bake.width * bake.height * bake.directions
        return samples, sum(stamp.size for stamp in self.inputs.files.values())


class ResultStore(AbstractContextManager["ResultStore"]):
    """The results of a batch, in its output folder and its cache; held for the length of a `with` block."""

    def __init__(self, output: Path, cache: Cache | None, options: BatchOptions, progress: BatchProgress) -> None:
        """Name both folders."""
        self._output, self._cache, self._options, self._watcher = output, cache, options, progress
        self._records = StateFolder(output)
        self._stack = ExitStack()
        self._added = False  # to the cache

    def __enter__(self) -> "ResultStore":
        """Keep other batches out; raises OutputError where a folder cannot be written."""
        self._stack.enter_context(self._records.held())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let other batches in, and prune the cache if it has grown."""
        self._stack.close()
        if self._cache is not None and self._added:
            self._cache.tidy(self._options.cache_size)

    def look(self, asset: Asset) -> AssetResult | PendingAsset:
        """Return the result of an asset that is there already, or is in the cache; else what has to be done."""
        try:
            return self._look(asset)
        except OSError as error:
            return _failed(asset, Failure("error", f"{asset.mesh}: cannot be looked at ({error}); check the disk"))

    def _look(self, asset: Asset) -> AssetResult | PendingAsset:
        key, folder = spec_key(asset, self._output), self._folder(asset)
        record = self._records.get(asset.name)
        there = record if record is not None and record.spec_key == key and self._is_whole(record, folder) else None
        if self._options.force:
            there = None
        if there is not None and there.inputs.are_now(asset.mesh):
            return AssetResult(asset, "unchanged", tuple(there.outputs), there.summary)
        inputs = InputFiles.of(asset.mesh)
        if there is not None and there.inputs.same_as(inputs):
            with suppress(OSError):  # then they are looked into the next time as well
                self._records.put(asset.name, AssetRecord(key, inputs, there.outputs, there.summary))
            return AssetResult(asset, "unchanged", tuple(there.outputs), there.summary)
        task = PendingAsset(asset, key, result_key(key, inputs), inputs, record)
        if self._cache is not None and not self._options.force:
            found = self._cache.get(task.key, self._records.staging)
            if found is not None:
                return self._placed(task, "cached", *found, seconds=0.0)
        return task

    def job(self, task: PendingAsset, threads: int) -> Job:
        """Return the job that makes an asset."""
        asset, folder = task.asset, self._folder(task.asset)
        staging = self._records.staging / secrets.token_hex(8)
        return Job(
            name=asset.name,
            mesh=Path(os.path.abspath(asset.mesh)),
            label=str(asset.mesh),
            folder=Path(os.path.abspath(folder)),
            stem=asset.stem,
            staging=Path(os.path.abspath(staging)),
            spec=asset.spec.with_threads(threads),
            scheduler=self._options.scheduler if self._options.split else None,
        )

    def take(self, task: PendingAsset, job: Job, outcome: Outcome) -> AssetResult:
        """Put what came of a job at its place and into the cache."""
        try:
            if isinstance(outcome, Failure):
                return _failed(task.asset, outcome)
            if not InputFiles.of(task.asset.mesh).same_as(task.inputs):
                found = f"{job.label}: was changed while it was worked on"
                return _failed(task.asset, Failure("error", f"{found}; run the batch again", seconds=outcome.seconds))
            self._keep(task, outcome)
            return self._placed(task, "made", outcome.files, outcome.summary, outcome.seconds)
        finally:
            shutil.rmtree(job.staging, ignore_errors=True)

    def prune(self, assets: Collection[str]) -> None:
        """Remove what earlier batches made of other assets than these, where nobody has changed it."""
        for name in sorted(set(self._records.names()) - set(assets)):
            if (record := self._records.get(name)) is not None:
                self._records.drop(name)
                self._remove(record.outputs, self._records.folder(name))
                self._watcher.note(f"removed what was made of {name}, which is not among these assets any more")

    def _remove(self, outputs: Mapping[str, FileStamp], folder: Path) -> None:
        """Remove files that no asset has now, if nobody has changed them, and their folder if nothing else is in it."""
        for name, stamp in outputs.items():
            if not self._records.has(folder / name) and FileStamp.of(folder / name).digest == stamp.digest:
                (folder / name).unlink(missing_ok=True)
        with suppress(OSError):
            folder.rmdir()

    def _keep(self, task: PendingAsset, made: Success) -> None:
        """Add a result to the cache; one that cannot be added is no loss but of time."""
        if self._cache is None:
            return
        try:
            self._added |= self._cache.put(task.key, made.files, made.summary)
        except OutputError as error:
            self._watcher.warn(f"{error}; the batch goes on without it")
            self._cache = None

    def _placed(
        self, task: PendingAsset, status: Status, files: dict[str, Path], summary: dict[str, Any], seconds: float
    ) -> AssetResult:
        """Move files from the staging folder to their places, and record them."""
        asset, folder = task.asset, self._folder(task.asset)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name in files:  # none is moved if one cannot be
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(folder / name))
            for name, file in files.items():
                os.replace(file, folder / name)
            stamps = {name: FileStamp.of(folder / name, certain=True) for name in sorted(files)}
            self._records.put(asset.name, AssetRecord(task.spec_key, task.inputs, stamps, summary))
            if task.before is not None and task.before.outputs.keys() - files.keys():
                self._remove(task.before.outputs, folder)
        except OSError as error:
            found = f"{error.filename2 or error.filename or folder}: cannot be written ({error.strerror or error})"
            return _failed(asset, Failure("error", f"{found}; choose another output", seconds=seconds))
        return AssetResult(asset, status, tuple(stamps), summary, seconds=seconds)

    def _is_whole(self, record: AssetRecord, folder: Path) -> bool:
        """Tell whether all outputs of a record are as they were written."""
        return all(
            stamp.is_now(folder / name) or FileStamp.of(folder / name).digest == stamp.digest
            for name, stamp in record.outputs.items()
        )

    def _folder(self, asset: Asset) -> Path:
        return self._records.folder(asset.name)


def _failed(asset: Asset, failure: Failure) -> AssetResult:
    status: Status = "stopped" if failure.kind == "stopped" else "failed"
    return AssetResult(asset, status, failure=failure, seconds=failure.seconds)
