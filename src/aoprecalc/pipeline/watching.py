"""What a batch says while it works."""

from dataclasses import dataclass
from typing import Any, Literal

from aoprecalc.pipeline.asset import Asset
from aoprecalc.pipeline.crew.work import Failure

Status = Literal["made", "unchanged", "cached", "failed", "stopped"]


@dataclass(frozen=True)
class Result:
    """What became of one asset.

    asset     it
    status    made: now; unchanged: it was there already; cached: taken from the cache; failed; stopped: not begun, or
              not finished, when the batch ended
    outputs   its files, names in its folder, sorted
    summary   what was made, see Made; None where nothing was
    failure   why it failed; None where it did not
    seconds   that it took
    """

    asset: Asset
    status: Status
    outputs: tuple[str, ...] = ()
    summary: dict[str, Any] | None = None
    failure: Failure | None = None
    seconds: float = 0.0


class Watcher:
    """Receives what a batch is doing; this base class looks on in silence."""

    def begin(self, total: int) -> None:
        """Begin with `total` assets."""

    def stage(self, asset: Asset, name: str) -> None:
        """See an asset come to a stage."""

    def end(self, result: Result) -> None:
        """See what became of an asset; each has its turn once."""

    def note(self, text: str) -> None:
        """Hear a line about what was done beside the assets."""

    def warn(self, text: str) -> None:
        """Hear a line that the user should know about the batch as a whole."""
