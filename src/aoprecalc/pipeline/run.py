"""A batch from beginning to end: plan it, find what is up to date, run jobs for the rest, report."""

import os
import signal
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import cache as memoize
from os import PathLike
from pathlib import Path

from aoprecalc.errors import ArgumentError, UsageError
from aoprecalc.options import BakeOptions, BatchOptions, SphereOptions
from aoprecalc.pipeline.discovery import base_folder, find_meshes, name_assets
from aoprecalc.pipeline.jobs import Asset, Job, JobSpec, Outcome
from aoprecalc.pipeline.manifest import read_manifest
from aoprecalc.pipeline.report import AssetResult, BatchProgress, BatchReport
from aoprecalc.pipeline.state import STATE_FOLDER, StateFolder
from aoprecalc.pipeline.store import CACHE_TAG, Cache, PendingAsset, ResultStore
from aoprecalc.pipeline.workers import ProcessPool, WorkerPool
from aoprecalc.visibility.backend import RayBackend, ray_note, takes_rays

_KNOWN_OUTPUTS = ("report.json", "spheres.json")  # suffixes of output names that are known before the work


@dataclass(frozen=True, eq=False)
class BatchResult:
    """The results of a batch.

    Attributes
    ----------
    results : tuple of AssetResult
        One for each asset, in the order of the assets.
    passed : bool
        Whether all assets are made, cached or unchanged.
    interrupted : bool
        Whether Ctrl-C or a signal ended the batch. Finished assets stay, the others are `stopped`.
    report : BatchReport
        Counts, and what is known of each asset; its `to_dict()` is the JSON report.

    """

    results: tuple[AssetResult, ...]
    passed: bool
    interrupted: bool
    report: BatchReport


def batch(
    patterns: str | PathLike[str] | Sequence[str | PathLike[str]],
    output: str | PathLike[str] | None = None,
    *,
    bake: BakeOptions | None = None,
    spheres: SphereOptions | None = None,
    cache: str | PathLike[str] | None = None,
    options: BatchOptions | None = None,
    progress: BatchProgress | None = None,
) -> BatchResult:
    """Bake the textures and fit the spheres of many meshes in several processes; skip what is up to date.

    An asset that fails does not stop the batch (unless `options.fail_fast`); its result says why it failed.

    Parameters
    ----------
    patterns : path or sequence of paths
        Mesh files, folders of them, or patterns with ``*``, ``?`` and ``**``; or one manifest (.toml), which also says
        what is made.
    output : path, optional
        The folder for the results, laid out as the inputs are. A manifest may name it instead.
    bake, spheres : BakeOptions, SphereOptions, optional
        What is made of each mesh. Without both, and without a manifest, a bake with default options.
    cache : path, optional
        A folder of results that batches share. Without it, no cache is used.
    options : BatchOptions, optional
        Number of processes, time-outs, retries, cluster.
    progress : BatchProgress, optional
        Receives the progress of the batch.

    Returns
    -------
    BatchResult

    Raises
    ------
    ArgumentError
        If an argument is of another type.
    InputError
        If a pattern matches no mesh or the manifest cannot be read.
    UsageError
        If the arguments contradict each other.
    OutputError
        If the output folder cannot be written. A cache that cannot be written is only a warning.
    AoprecalcError
        If a cluster cannot be reached or used.
    """
    paths = list(patterns) if isinstance(patterns, Iterable) and not isinstance(patterns, str) else [patterns]
    kinds = [type(path).__name__ for path in paths if not isinstance(path, str | PathLike)]
    if kinds or not paths:
        found = f"a value of type {kinds[0]}" if kinds else "no value"
        raise ArgumentError("patterns", f"has {found}, a path or a sequence of paths was expected")
    for argument, value, kind, expected in (
        ("output", output, (str, PathLike), "a path"),
        ("bake", bake, BakeOptions, "BakeOptions"),
        ("spheres", spheres, SphereOptions, "SphereOptions"),
        ("cache", cache, (str, PathLike), "a path"),
        ("options", options, BatchOptions, "BatchOptions"),
    ):
        if value is not None and (not isinstance(value, kind) or value == ""):
            found = "empty" if value == "" else f"of type {type(value).__name__}"
            raise ArgumentError(argument, f"is {found}, {expected} was expected")
    spec = JobSpec(bake, spheres) if bake or spheres else None
    return run_batch(plan_batch([os.fspath(path) for path in paths], output, spec), cache, options, progress)


@dataclass(frozen=True)
class Plan:
    """What a batch makes.

    assets     with distinct names
    output     the folder for the results
    manifest   the file that describes the batch; None: none
    notes      lines about the manifest that are no errors
    """

    assets: tuple[Asset, ...]
    output: Path
    manifest: Path | None = None
    notes: tuple[str, ...] = ()

    def protected_files(self) -> list[Path]:
        """Return the files that no report may replace: meshes, the manifest, and outputs whose names are known."""
        outputs = [self.output / f"{asset.name}_{suffix}" for asset in self.assets for suffix in _KNOWN_OUTPUTS]
        return [*outputs, *(asset.mesh for asset in self.assets), *([self.manifest] if self.manifest else [])]


def plan_batch(patterns: Sequence[str], output: str | os.PathLike[str] | None, spec: JobSpec | None) -> Plan:
    """Plan a batch over the meshes that patterns match, or over a single manifest.

    spec   for every asset; None: a bake with default options, or what the manifest says
    Outputs of batches, and files in the output folder, are no assets, unless the assets are in that folder themselves.
    Raises InputError, UsageError.
    """
    manifests = [pattern for pattern in patterns if pattern.lower().endswith(".toml")]
    if not manifests:
        if output is None:
            raise UsageError("no output folder was given; name one with --output")
        base = base_folder(patterns)
        meshes = find_meshes(patterns, _output_predicate(Path(output), base))
        named = zip(name_assets(meshes, base), meshes, strict=True)
        return Plan(tuple(Asset(name, mesh, spec or JobSpec(BakeOptions())) for name, mesh in named), Path(output))
    if len(patterns) > 1:
        raise UsageError(f"{manifests[0]} is a manifest, but other inputs were given as well; put them into it")
    if spec is not None:
        raise UsageError(f"{manifests[0]} is a manifest and says itself what is made; put --bake, --spheres into it")
    manifest = read_manifest(Path(manifests[0]))
    folder = output or manifest.output
    if folder is None:
        raise UsageError(f'{manifests[0]} names no output folder; add output = "build", or give -o')
    notes: list[str] = []
    assets = manifest.assets_of(_output_predicate(Path(folder), manifest.base), notes.append)
    return Plan(tuple(assets), Path(folder), manifest.path, tuple(notes))


def _output_predicate(output: Path, base: Path) -> Callable[[Path], bool]:
    """Return a function that tells whether a file is an output of a batch, this one or another."""
    output_folder = Path(os.path.realpath(output))
    is_apart = not Path(os.path.realpath(base)).is_relative_to(output_folder)

    @memoize
    def in_cache(folder: Path) -> bool:
        return (folder / CACHE_TAG).exists() or (folder != folder.parent and in_cache(folder.parent))

    @memoize
    def outputs(folder: Path) -> frozenset[Path]:
        """Return the recorded outputs of batches into a folder and the folders above it."""
        above = outputs(folder.parent) if folder != folder.parent else frozenset()
        return above | StateFolder(folder).outputs() if (folder / STATE_FOLDER).is_dir() else above

    def is_output(path: Path) -> bool:
        real = Path(os.path.realpath(path))
        return (
            real in outputs(real.parent) or in_cache(real.parent) or (is_apart and real.is_relative_to(output_folder))
        )

    return is_output


def run_batch(
    plan: Plan,
    cache: str | PathLike[str] | None = None,
    options: BatchOptions | None = None,
    progress: BatchProgress | None = None,
) -> BatchResult:
    """Carry out a plan; see `batch`."""
    started, options, progress = time.perf_counter(), options or BatchOptions(), progress or BatchProgress()
    results: dict[str, AssetResult] = {}
    interrupted = said_rays = False

    def finish(result: AssetResult) -> bool:
        """Keep a result; return whether the batch ends with it."""
        nonlocal said_rays
        results[result.asset.name] = result
        progress.end(result)
        if not said_rays and _fell_to_rays(result):
            progress.note(ray_note())
            said_rays = True
        return options.fail_fast and result.status == "failed"

    with ResultStore(plan.output, None if cache is None else Cache(Path(cache)), options, progress) as store:
        progress.begin(len(plan.assets))
        for line in plan.notes:
            progress.note(line)
        try:
            pending = []
            for asset in plan.assets:
                with defer_interrupts():  # files that are in place are in the report, too
                    found = store.find(asset)
                    is_over = isinstance(found, AssetResult) and finish(found)
                if is_over:
                    break
                if isinstance(found, PendingAsset):
                    pending.append(found)
            else:
                with closing(_run_jobs(pending, store, options, progress)) as outcomes:
                    for entry, job, outcome in outcomes:
                        with defer_interrupts():
                            is_over = finish(store.accept(entry, job, outcome))
                        if is_over:
                            break
            if options.prune:
                store.prune({asset.name for asset in plan.assets})
        except KeyboardInterrupt:
            interrupted = True
    for asset in plan.assets:
        if asset.name not in results:
            finish(AssetResult(asset, "stopped"))
    ordered = tuple(results[asset.name] for asset in plan.assets)
    passed = all(result.status in ("made", "unchanged", "cached") for result in ordered)
    report = BatchReport.of(ordered, plan.output, time.perf_counter() - started)
    return BatchResult(ordered, passed, interrupted, report)


def _fell_to_rays(result: AssetResult) -> bool:
    """Tell whether an asset has just been baked by rays although that is slower and nobody asked for it."""
    bake, summary = result.asset.spec.bake, result.summary or {}
    is_free = bake is not None and bake.backend == "auto" and not takes_rays(bake)
    return is_free and result.status == "made" and summary.get("renderer") == RayBackend.name


@contextmanager
def open_pool(count: int, options: BatchOptions) -> Iterator[WorkerPool]:
    """Open the worker pool that the options ask for, for `count` jobs.

    Raises UsageError if a cluster is asked for in a wrong way, AoprecalcError if it cannot be reached or used.
    """
    if options.scheduler is None or options.split:
        yield ProcessPool(count, options)
        return
    from aoprecalc.pipeline.dask_client import open_dask_pool  # needs an extra

    with open_dask_pool(options) as pool:
        yield pool


def _run_jobs(
    pending: list[PendingAsset], store: ResultStore, options: BatchOptions, progress: BatchProgress
) -> Generator[tuple[PendingAsset, Job, Outcome]]:
    """Run the jobs of assets; yield each asset and job with its outcome, as they end."""
    if not pending:
        return
    by_name = {entry.asset.name: entry for entry in pending}
    longest_first = sorted(pending, key=PendingAsset.cost, reverse=True)  # so that no long job runs alone at the end
    with open_pool(len(pending), options) as pool:
        jobs = [store.job(entry, pool.threads) for entry in longest_first]
        with closing(pool.run(jobs)) as events:
            for event in events:
                entry = by_name[event.job.name]
                if event.outcome is None:
                    progress.stage(entry.asset, event.stage)
                else:
                    yield entry, event.job, event.outcome


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Defer Ctrl-C and requests to terminate until the end of a `with` block.

    Only signals with a handler written in Python are deferred, such as one that raises KeyboardInterrupt; others end
    the process at once. Outside the main thread, where no handler runs, nothing is done.
    """
    with ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM):
            stack.enter_context(_defer(number))
        yield


@contextmanager
def _defer(number: signal.Signals) -> Iterator[None]:
    handler = signal.getsignal(number)
    is_pending = False

    def note(*_: object) -> None:
        nonlocal is_pending
        is_pending = True

    try:
        if callable(handler):
            try:
                signal.signal(number, note)
            except ValueError:  # not the main thread
                handler = None
        yield
    finally:
        if callable(handler):
            signal.signal(number, handler)
            if is_pending:
                signal.raise_signal(number)
