"""Ctrl-C and requests to end, held back while something must not be cut in two."""

import os
import signal
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from aoprecalc.options import BakeOptions, BatchOptions, SphereOptions
from aoprecalc.pipeline.cache import Cache
from aoprecalc.pipeline.jobs import Job, JobSpec, Outcome
from aoprecalc.pipeline.plan import Plan, plan_batch
from aoprecalc.pipeline.report import AssetResult, BatchProgress, batch_report
from aoprecalc.pipeline.store import PendingAsset, ResultStore
from aoprecalc.pipeline.workers import ProcessPool, WorkerPool

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Have an interruption that comes in a `with` block take effect at the block's end.

    Only handlers written in Python are held back, as those that raise KeyboardInterrupt are; a signal that ends the
    process at once still does. Outside the main thread, where no handler runs, nothing has to be done.
    """
    with ExitStack() as stack:
        for number in _NUMBERS:
            stack.enter_context(_defer(number))
        yield


@contextmanager
def _defer(number: signal.Signals) -> Iterator[None]:
    handler = signal.getsignal(number)
    came = False

    def note(*_: object) -> None:
        nonlocal came
        came = True

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
            if came:
                signal.raise_signal(number)


# Batch: from many mesh files to their textures and spheres, each made once and only when it must be.


@dataclass(frozen=True, eq=False)
class BatchResult:
    """What became of each asset, in the assets' order.

    passed        all are there
    interrupted   by Ctrl-C or a signal: what was finished stays, the rest is `stopped`
    report        of plain JSON values; see the README for its keys
    """

    results: tuple[AssetResult, ...]
    passed: bool
    interrupted: bool
    report: dict[str, Any]


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
    """Bake the textures and fit the spheres of many meshes, in several processes; what is there already stays.

    patterns   mesh files, folders of them, names with *, ? and **; or one manifest (.toml), which says what is made
    output     the folder for the results, in which each asset has the place that it has among the inputs
    bake, spheres   what is made of each; a bake with the defaults if neither is given
    cache      a folder of results that batches share; None: none
    An asset that fails is an answer, not an error: the others are made. Raises InputError where a pattern fits nothing,
    UsageError where something cannot be asked for so, OutputError where the output folder cannot be written. A cache
    that cannot be is a warning. AoprecalcError where a cluster cannot be reached or used.
    """
    paths = [patterns] if isinstance(patterns, str | PathLike) else list(patterns)
    spec = JobSpec(bake, spheres) if bake or spheres else None
    return run_batch(plan_batch([os.fspath(path) for path in paths], output, spec), cache, options, progress)


def run_batch(
    planned: Plan,
    cache: str | PathLike[str] | None = None,
    options: BatchOptions | None = None,
    progress: BatchProgress | None = None,
) -> BatchResult:
    """Do what is planned; see `batch`."""
    assets, output = planned.assets, planned.output
    started, options, progress = time.perf_counter(), options or BatchOptions(), progress or BatchProgress()
    results: dict[str, AssetResult] = {}
    interrupted = False

    def end(result: AssetResult) -> bool:
        """Note a result; return whether the batch is over with it."""
        results[result.asset.name] = result
        progress.end(result)
        return options.fail_fast and result.status == "failed"

    with ResultStore(output, None if cache is None else Cache(Path(cache)), options, progress) as store:
        progress.begin(len(assets))
        for line in planned.warnings:
            progress.warn(line)
        try:
            tasks = []
            for asset in assets:
                with defer_interrupts():  # files that are at their places are in the report, too
                    found = store.look(asset)
                    over = not isinstance(found, PendingAsset) and end(found)
                if over:
                    break
                if isinstance(found, PendingAsset):
                    tasks.append(found)
            else:
                with closing(_done(tasks, store, options, progress)) as done:
                    for task, job, outcome in done:
                        with defer_interrupts():
                            over = end(store.take(task, job, outcome))
                        if over:
                            break
            if options.prune:
                store.prune({asset.name for asset in assets})
        except KeyboardInterrupt:
            interrupted = True
    stopped = [asset for asset in assets if asset.name not in results]
    for asset in stopped:
        end(AssetResult(asset, "stopped"))
    ordered = tuple(results[asset.name] for asset in assets)
    passed = all(result.status in ("made", "unchanged", "cached") for result in ordered)
    report = batch_report(ordered, output, time.perf_counter() - started)
    return BatchResult(ordered, passed, interrupted, report)


@contextmanager
def open_pool(count: int, options: BatchOptions) -> Iterator[WorkerPool]:
    """Open the crew that is asked for, for `count` jobs.

    Raises UsageError where a cluster is asked for in a wrong way, AoprecalcError where it cannot be reached or used.
    """
    if options.scheduler is None or options.split:
        yield ProcessPool(count, options)
        return
    from aoprecalc.pipeline.dask_client import open_dask_pool  # needs an extra

    with open_dask_pool(options) as cluster:
        yield cluster


def _done(
    tasks: list[PendingAsset], store: ResultStore, options: BatchOptions, progress: BatchProgress
) -> Generator[tuple[PendingAsset, Job, Outcome]]:
    """Have a crew do the tasks; yield each with what came of it."""
    if not tasks:
        return
    tasks.sort(key=PendingAsset.weight, reverse=True)  # the longest first, lest one be alone at the end
    of_job = {task.asset.name: task for task in tasks}
    with open_pool(len(tasks), options) as crew:
        jobs = [store.job(task, crew.threads) for task in tasks]
        with closing(crew.run(jobs)) as events:
            for event in events:
                task = of_job[event.job.name]
                if event.outcome is None:
                    progress.stage(task.asset, event.stage)
                else:
                    yield task, event.job, event.outcome
