"""What tells how much the texels of a side see along one group of axes after the other."""

from collections.abc import Callable
from typing import Protocol

from aoprecalc.model import Floats
from aoprecalc.occlusion.site import Side, Site
from aoprecalc.occlusion.turns import Turns
from aoprecalc.progress import Progress
from aoprecalc.texspace.samples import Samples


class Sight(Protocol):
    """Tells visibility sums; whoever tells them, they are the same."""

    def sums(self, samples: Samples, held: slice, group: int) -> Floats:
        """Return what a run of the side's texels sees along a group of axes, (k, 2) float32; see Observer.

        samples   of the texels `held`, at the spot of the group
        Groups come in order, and for each the runs in order.
        """
        ...


class OwnSight:
    """Looks by itself, with the observer of the site's backend."""

    def __init__(self, site: Site, side: Side, shadow_size: int, most: int, progress: Progress) -> None:
        """Make an observer of up to `most` texels at a time; directions done are counted on `progress`."""
        self._observer = site.backend.observer(side.surface, most, shadow_size)
        self._turns = Turns.of(site.subject.scene)
        self._site, self._progress = site, progress

    def sums(self, samples: Samples, held: slice, group: int) -> Floats:
        """See Sight."""
        axes = self._site.axes[self._site.groups[group]]
        return self._turns.look(self._observer, samples, axes, group, self._progress)


OpenSight = Callable[[Site, Side, int, int, Progress], Sight]  # as OwnSight is made
