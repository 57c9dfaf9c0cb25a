"""A sight that is spread over the workers of a cluster: each looks along some groups of axes."""

import pickle
import secrets
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np

from aoprecalc import __version__
from aoprecalc.errors import AoprecalcError
from aoprecalc.model import Floats
from aoprecalc.occlusion.portion import runs
from aoprecalc.occlusion.site import Side, Site
from aoprecalc.pipeline.cluster.remote import Terms, end, look_elsewhere
from aoprecalc.pipeline.cluster.workers import open_client, threads_of_a_job
from aoprecalc.pipeline.crew.glance import Glance, Seen
from aoprecalc.progress import Progress
from aoprecalc.texspace.samples import Samples


class Spread(AbstractContextManager["Spread"]):
    """Opens sights that are spread over a cluster, for the length of a `with` block."""

    def __init__(self, scheduler: str, shown: str) -> None:
        """Connect to a scheduler; `shown` is what messages call the work. Raises what `open_client` does."""
        with ExitStack() as stack:
            self._client = stack.enter_context(open_client(scheduler))
            self._threads = threads_of_a_job(self._client)
            self._stack = stack.pop_all()
        self._shown, self._terms = shown, Terms(secrets.token_hex(8), __version__)
        self._sights: list[SpreadSight] = []

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes that have looked."""
        with self._stack, suppress(Exception):  # workers or scheduler that are gone have no such processes
            self._client.cancel([future for sight in self._sights for future in sight.left()])
            self._client.run(end, self._terms.batch)

    def __call__(self, site: Site, side: Side, shadow_size: int, most: int, progress: Progress) -> "SpreadSight":
        """Have the workers begin to look; see OpenSight."""
        options = replace(site.subject.options, threads=self._threads)
        subject = replace(site.subject, scene=replace(site.subject.scene, document=None), options=options)
        sent = self._client.scatter(pickle.dumps(subject), hash=False, broadcast=True)
        held = runs(len(side.texels), most)
        name, number = secrets.token_hex(8), site.sides.index(side)
        futures: dict[tuple[int, int], Any] = {}
        for group in range(len(site.groups)):
            for run in held:
                glance = Glance(self._shown, name, b"", number, group, run.start, run.stop, most, shadow_size)
                futures[group, run.start] = self._client.submit(
                    look_elsewhere, glance, sent, self._terms, pure=False, priority=-len(futures)
                )
        self._sights.append(SpreadSight(site, futures, progress))
        return self._sights[-1]


class SpreadSight:
    """Waits for what others see; a Sight."""

    def __init__(self, site: Site, futures: dict[tuple[int, int], Any], progress: Progress) -> None:
        """Have the futures of (group, first texel of a run)."""
        self._site, self._futures, self._progress = site, futures, progress

    def sums(self, samples: Samples, held: slice, group: int) -> Floats:
        """See Sight; raises AoprecalcError where a worker could not look."""
        future = self._futures.pop((group, held.start))
        try:
            outcome = future.result()
        except Exception as error:  # of whatever kind the cluster raises for workers that are lost
            reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
            found = f"the cluster could not look along group {group} of the axes ({reason})"
            raise AoprecalcError(
                f"{found}; see to its scheduler and workers, and run the same command again"
            ) from error
        if not isinstance(outcome, Seen):
            raise AoprecalcError(outcome.message)
        axes = self._site.groups[group]
        self._progress.advance(2 * (axes.stop - axes.start))
        return np.asarray(outcome.sums)

    def left(self) -> list[Any]:
        """Return the futures that nobody has waited for, as where the target error was reached."""
        return list(self._futures.values())
