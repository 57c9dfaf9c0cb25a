"""Part of a bake's visibility, done elsewhere: what a run of texels sees along one group of axes."""

import pickle
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from aoprecalc.errors import AoprecalcError
from aoprecalc.pipeline.jobs import Failure
from aoprecalc.progress import Progress
from aoprecalc.types import Float32Array
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.gather import LocalVisibility, VisibilitySource
from aoprecalc.visibility.setup import BakeInputs, BakeSetup


@dataclass(frozen=True, eq=False)
class VisibilityTask:
    """Where to look.

    shown         what messages call it
    name          of the subject, the same for all glances at it
    subject       a Subject, pickled
    side, group   their numbers at the Site
    start, stop   the run of the side's texels
    most          texels that are looked at at a time, of any glance at the subject
    shadow_size   side of a map
    """

    shown: str
    name: str
    subject: bytes
    side: int
    group: int
    start: int
    stop: int
    most: int
    shadow_size: int


@dataclass(frozen=True, eq=False)
class VisibilitySums:
    """The visibility sums of a glance, (stop - start, 2) float32, and the seconds that it took."""

    sums: Float32Array
    seconds: float = 0.0


class VisibilityWorker:
    """Glances at one subject after the other, and keeps the present one ready."""

    def __init__(self) -> None:
        """Look at nothing yet."""
        self._stack = ExitStack()
        self._name, self._side = "", -1
        self._site: BakeSetup | None = None
        self._sight: VisibilitySource | None = None

    def look(self, glance: VisibilityTask) -> VisibilitySums | Failure:
        """Return what is seen, or why nothing is."""
        try:
            site, sight = self._turn_to(glance)
            held = slice(glance.start, glance.stop)
            samples = site.samples(site.sides[glance.side], held, glance.group)
            sums = sight.visibility_sums(samples, held, glance.group)
            site.backend.check_errors()
        except (AoprecalcError, MemoryError, OSError) as error:
            return Failure("error", f"{glance.shown}: {error}", getattr(error, "exit_code", 1))
        return VisibilitySums(np.asarray(sums))

    def _turn_to(self, glance: VisibilityTask) -> tuple[BakeSetup, VisibilitySource]:
        """Return the site and the sight of a glance, which are made unless they are there."""
        if glance.name != self._name or self._site is None:
            self._sight = self._site = None
            self._stack.close()
            subject: BakeInputs = pickle.loads(glance.subject)
            backend = self._stack.enter_context(open_backend(subject.options, Progress()))
            self._site, self._name, self._side = BakeSetup(backend, subject), glance.name, -1
        if self._side != glance.side or self._sight is None:
            self._sight = None  # two at a time would hold twice the memory
            side = self._site.sides[glance.side]
            self._sight = LocalVisibility(self._site, side, glance.shadow_size, glance.most, Progress())
            self._side = glance.side
        return self._site, self._sight
