"""What this machine can render with: each renderer is tried in a process of its own, which it may crash or hang."""

import json
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event
from typing import Any

from aoprecalc.children import ask, command
from aoprecalc.gl.context import CANDIDATES, Candidate

PATIENCE = 20.0  # seconds that a probe may take; it needs a tenth of one


@dataclass(frozen=True)
class Answer:
    """What a probe found.

    facts    what it says of itself; empty where it does not work
    fault    why it does not work; empty where it does
    deadly   its process crashed or hung, as a bake that tried it would
    """

    facts: dict[str, Any] = field(default_factory=dict)
    fault: str = ""
    deadly: bool = False

    @property
    def works(self) -> bool:
        """Tell whether it works."""
        return not self.fault


@dataclass(frozen=True)
class Found:
    """What all that may render have answered: for OpenGL, in the order in which a bake tries them, and for rays."""

    opengl: tuple[tuple[Candidate, Answer], ...]
    rays: Answer


def probe_all() -> Found:
    """Try every EGL device, OSMesa and Embree, at the same time."""
    count, osmesa, rays = examine_all([_child("gl", "count"), _child("gl", "osmesa"), _child("rays")])
    # Without a number the first device is tried, if only for the reason that a bake would give.
    there = max(1, count.facts.get("devices", 1))
    devices = [candidate for candidate in CANDIDATES if candidate.kind == "egl"][:there]
    answers = examine_all([_child("gl", "egl", str(candidate.device)) for candidate in devices])
    others = [(candidate, osmesa) for candidate in CANDIDATES if candidate.kind == "osmesa"]
    return Found((*zip(devices, answers, strict=True), *others), rays)


def examine_all(commands: Sequence[list[str]], patience: float = PATIENCE) -> list[Answer]:
    """Return what each of the commands answers; they run at the same time, and none is left when this returns."""
    over = Event()
    with ThreadPoolExecutor(len(commands)) as pool:
        asked = [pool.submit(_examine, command, patience, over) for command in commands]
        try:
            return [answer.result() for answer in asked]
        finally:
            over.set()  # after a Ctrl-C, which only this thread hears of


def _examine(command: list[str], patience: float, over: Event) -> Answer:
    """Return what a command answers: one line of JSON, the last on its standard output."""
    started = time.monotonic()

    def look(step: str) -> None:
        if over.is_set() or time.monotonic() - started > patience:
            raise TimeoutError(f"it hangs: no answer within {patience:g} s")

    try:
        facts = json.loads(ask(command, b"", look).splitlines()[-1])
    except (ChildProcessError, TimeoutError) as error:
        return Answer(fault=str(error), deadly=True)
    except (ValueError, IndexError):
        return Answer(fault="it ended without an answer", deadly=True)
    fault = facts.get("fault", "")
    return Answer({} if fault else facts, fault)


def _child(folder: str, *request: str) -> list[str]:
    return command(f"aoprecalc.{folder}.probe_child", *request)
