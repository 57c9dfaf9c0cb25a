"""What this machine can render with: each renderer is tried in a process of its own, which it may crash or hang."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event
from typing import Any

from aoprecalc import __version__
from aoprecalc.gl.context import CANDIDATES, INSTALLS, VERSION, Candidate
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.progress import Progress, Stopwatch
from aoprecalc.subprocesses import ChildStoppedError, ChildTimeoutError, ask, command
from aoprecalc.system import EXTRAS, LIBRARIES, environment, machine, versions

PROBE_SECONDS = 20.0  # that a probe may take; it needs a tenth of one


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
    count, osmesa, rays = run_probes([_child("count"), _child("osmesa"), _child("rays")])
    # Without a number the first device is tried, if only for the reason that a bake would give.
    there = max(1, count.facts.get("devices", 1))
    devices = [candidate for candidate in CANDIDATES if candidate.kind == "egl"][:there]
    answers = run_probes([_child("egl", str(candidate.device)) for candidate in devices])
    others = [(candidate, osmesa) for candidate in CANDIDATES if candidate.kind == "osmesa"]
    return Found((*zip(devices, answers, strict=True), *others), rays)


def run_probes(commands: Sequence[list[str]], timeout: float = PROBE_SECONDS) -> list[Answer]:
    """Return the answer of each command; they run at the same time, and none runs on after this returns or raises."""
    stop = Event()
    with ThreadPoolExecutor(len(commands)) as pool:
        futures = [pool.submit(_probe, command, timeout, stop) for command in commands]
        try:
            return [future.result() for future in futures]
        finally:
            stop.set()  # Ctrl-C raises in this thread alone


def _probe(command: list[str], timeout: float, stop: Event) -> Answer:
    """Return the answer of one probe: a line of JSON, the last on its standard output."""
    try:
        facts = json.loads(ask(command, timeout=timeout, stop=stop).splitlines()[-1])
    except ChildTimeoutError as error:
        return Answer(fault=f"it hangs: {error}", deadly=True)
    except (ChildProcessError, ChildStoppedError) as error:
        return Answer(fault=str(error), deadly=True)
    except (ValueError, IndexError):
        return Answer(fault="it ended without an answer", deadly=True)
    fault = facts.get("fault", "")
    return Answer({} if fault else facts, fault)


def _child(*request: str) -> list[str]:
    return command("aoprecalc.api.probe", *request)


# Doctor: what this machine can bake with, whether a small bake comes out right, and what to install.


_TRIAL = command("aoprecalc.api.self_test")
_SELF_TEST_SECONDS = 60.0  # that the self-test may take; two are plenty on two cores
_OPENGL = f"OpenGL {VERSION[0]}.{VERSION[1]}"
_WHY = {
    "gl": f"the first that makes an {_OPENGL} context",
    "ray": f"there is no {_OPENGL}, and rays can be traced",
}
_USES = {
    "ray": "to trace rays where there is no OpenGL, and to verify",
    "compressed": "to read Draco and meshopt meshes (meshoptimizer needs a C++ compiler)",
    "formats": "to read COLLADA and 3MF",
    "cluster": "to share batches among machines",
}


@dataclass(frozen=True, eq=False)
class Checkup:
    """Whether the self-test passed, and the report (see the README for its keys)."""

    passed: bool
    report: dict[str, Any]


def doctor(progress: Progress | None = None) -> Checkup:
    """Try all that may render, bake a small scene with what a bake would take, and say what to install.

    Neither a broken driver nor a machine without any renderer is an error: both are found in the report.
    """
    watch = Stopwatch(progress or Progress())
    with watch.stage("renderers"):
        found = probe_all()
    choice, chosen = _choice(found)
    trial = None
    if choice is not None:
        with watch.stage("self-test"):
            trial = _trial() if chosen.works else {"passed": False, "fault": chosen.fault}
    passed = trial is not None and bool(trial["passed"])
    extras = {extra: versions(names) for extra, names in EXTRAS.items()}
    report = {
        "schema": SCHEMAS["doctor"],
        "version": __version__,
        "machine": machine(),
        "environment": environment(),
        "renderers": [
            {"name": name, "backend": backend, "works": answer.works, "fault": answer.fault or None, **answer.facts}
            for name, backend, answer in _ways(found)
        ],
        "auto": choice,
        "self_test": trial,
        "libraries": versions(LIBRARIES),
        "extras": extras,
        "install": _install(found, extras),
        "passed": passed,
        "seconds": watch.seconds(),
    }
    return Checkup(passed, report)


def _ways(found: Found) -> list[tuple[str, str, Answer]]:
    """Return name, backend and answer of all that may render, in the order in which --backend auto tries them."""
    return [*((candidate.name, "gl", answer) for candidate, answer in found.opengl), ("Embree", "ray", found.rays)]


def _choice(found: Found) -> tuple[dict[str, Any] | None, Answer]:
    """Return what --backend auto takes and why, and what its probe answered; None where nothing renders.

    A bake that comes to a driver that crashes or hangs gets no further, whatever works behind it.
    """
    for name, backend, answer in _ways(found):
        if answer.works or answer.deadly:
            why = _WHY[backend] if answer.works else f"a bake comes to it and gets no further ({answer.fault})"
            return {"name": name, "backend": backend, "why": why}, answer
    return None, found.rays


def _trial() -> dict[str, Any]:
    """Return what the self-test measured; `fault` says why where it could not."""
    (answer,) = run_probes([_TRIAL], _SELF_TEST_SECONDS)
    return {"passed": False, **answer.facts, "fault": answer.fault or None}


def _install(found: Found, extras: dict[str, dict[str, str | None]]) -> list[dict[str, Any]]:
    """Return what is missing: `what`, what it is `for`, and the `lines` that install it, by system or for `any`."""
    missing: list[dict[str, Any]] = []
    if not any(answer.works for _, answer in found.opengl):
        missing.append(
            {"what": _OPENGL, "for": "to bake by depth maps, which is faster than by rays", "lines": INSTALLS.copy()}
        )
    for extra, packages in extras.items():
        absent = [name for name, version in packages.items() if version is None]
        if extra == "ray" and not found.rays.works:
            absent = list(packages)
        if absent:
            line = f"pip install 'aoprecalc[{extra}]'"
            missing.append({"what": ", ".join(absent), "for": _USES[extra], "lines": {"any": line}})
    return missing
