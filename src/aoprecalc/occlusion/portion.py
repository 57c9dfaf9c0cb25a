"""How many texels are looked at at a time, which bounds memory; the result is the same, maps are drawn more often."""

import os
import sys
from pathlib import Path

from aoprecalc.errors import UsageError

PART = 1 << 20  # texels that are fitted at a time, whatever the portion, so that no sum depends on it
_MOST_PARTS = 8  # without a limit: drawing maps twice for 4096^2 texels takes a tenth longer, and saves 400 MB

# Bytes that a bake takes beyond what it holds before it looks at anything; measured, on the high side.
_OF_PICTURE = 36  # a texel of the picture: the fit's planes, and those of one spot
_OF_COVERED = 24  # a texel that the surface covers: its index and the sums of both halves
_OF_HELD = 60  # a texel of the portion: its sample, its receiver, its sums
_OF_SOLVING = 76  # a texel of the picture, while the fit is solved and nothing is looked at
_OF_HELD_BEFORE = 16  # a texel of the portion, then: what the system was not given back
_OF_TRIANGLE = 400  # while occluders are sorted and uploaded
_OF_MAPS = 1 << 26  # what a batch of maps takes, unless a single axis takes more
_REST = 80 << 20  # that, and what the renderer compiles and keeps
_DRIFT = 16  # megabytes by which what a process holds differs from one run to the next


def portion(limit: int | None, size: str, picture: int, covered: int, maps: int, triangles: int) -> int:
    """Return the most texels that can be looked at at a time within `limit` bytes of memory; None is no limit.

    It is a multiple of PART, or all that are covered.
    size      of the picture, as it is called in messages
    picture   how many texels it has, `covered` of them by the surface
    maps      bytes of the near/far maps of one axis; triangles: of the mesh
    Raises UsageError where not even PART texels fit.
    """
    most = _MOST_PARTS * PART
    if limit is None:
        return min(most, covered)
    present = _resident() + _REST + max(0, maps - _OF_MAPS) + triangles * _OF_TRIANGLE

    def need(held: int) -> int:
        looking = picture * _OF_PICTURE + covered * _OF_COVERED + held * _OF_HELD
        solving = picture * _OF_SOLVING + held * _OF_HELD_BEFORE
        return present + max(looking, solving)

    for held in range(most, 0, -PART):
        if need(min(held, covered)) <= limit:
            return min(held, covered)
    enough = (need(min(PART, covered)) >> 20) + _DRIFT
    raise UsageError(
        f"--memory-limit is {limit >> 20}M; {size} texels of this mesh need {enough}M; "
        "use a higher limit or a smaller --size"
    )


def runs(count: int, portion: int) -> list[slice]:
    """Cut `count` texels into runs of `portion`, the last one possibly shorter."""
    return [slice(start, min(start + portion, count)) for start in range(0, count, portion)]


def _resident() -> int:
    """Bytes of memory that this process holds; where only that is told, the most that it has held.

    Raises UsageError where the system tells neither.
    """
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        try:
            import resource
        except ModuleNotFoundError as error:
            raise UsageError(
                "--memory-limit needs to know how much memory is held, which this system does not tell; omit it"
            ) from error
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most if sys.platform == "darwin" else most * 1024
