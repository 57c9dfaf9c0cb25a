"""What tells which directions the samples on a surface see. There are two kinds: by maps and by rays."""

from typing import Protocol

from aoprecalc.model import Doubles, Floats
from aoprecalc.progress import Progress
from aoprecalc.texspace.samples import Samples


class Observer(Protocol):
    """Measures visibility for samples, again and again."""

    def look(self, samples: Samples, axes: Doubles, progress: Progress) -> Floats:
        """Return what k samples see along (a, 3) axes, (k, 2) float32 sums over both directions of each.

        The first is of max(0, n.w) [g.w > 0] visible(w), the second is the same without visible(w); both are 0 where
        there is no sample. Directions done are counted on `progress`, two an axis.
        """
        ...
