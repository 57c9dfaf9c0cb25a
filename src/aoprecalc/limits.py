"""How many cores and how much memory this process may use; a container's limits count."""

import os
from pathlib import Path

_CGROUP = Path("/sys/fs/cgroup")  # what the container that this runs in may use (version 2)


def usable_cores() -> float:
    """Return how many cores may be used, perhaps a fraction."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = _limit("cpu.max")  # "max 100000", or microseconds that may be used in so many
    return min(cores, round(int(quota[0]) / int(quota[1]), 2)) if quota else cores


def whole_cores() -> int:
    """Return the same as a number of threads, at least 1."""
    return max(1, int(usable_cores()))


def usable_memory() -> int | None:
    """Return how many bytes of memory may be used; None where the system does not tell."""
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    limit = _limit("memory.max")
    return min(memory, int(limit[0])) if limit else memory


def _limit(name: str) -> list[str]:
    """Return the numbers of a limit of the container; none where there is no such limit."""
    try:
        words = (_CGROUP / name).read_text(encoding="ascii").split()
    except OSError:
        return []
    return words if words and words[0] != "max" else []
