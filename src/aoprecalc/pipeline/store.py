"""The results of a batch: what is up to date, what can be taken from the cache, and moving new results into place."""

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
        samples = 0 if bake is None else bake.width * bake.height * bake.directions
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
        inputs = InputFiles.of(asset.mesh)
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

    def accept(self, pending: PendingAsset, job: Job, outcome: Outcome) -> AssetResult:
        """Move the files of a successful job into place and into the cache; return the asset's result."""
        try:
            if isinstance(outcome, Failure):
                return _failed(pending.asset, outcome)
            if not InputFiles.of(pending.asset.mesh).same_contents(pending.inputs):
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
