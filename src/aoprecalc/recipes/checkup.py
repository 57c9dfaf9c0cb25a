"""Doctor: what this machine can bake with, whether a small bake comes out right, and what to install."""

from dataclasses import dataclass
from typing import Any

from aoprecalc import __version__
from aoprecalc.children import command
from aoprecalc.gl.context import INSTALLS, VERSION
from aoprecalc.progress import Progress
from aoprecalc.recipes.machine import EXTRAS, LIBRARIES, environment, machine, versions
from aoprecalc.recipes.probing import Answer, Found, examine_all, probe_all
from aoprecalc.recipes.stopwatch import Stopwatch

SCHEMA = 1

_TRIAL = command("aoprecalc.recipes.trial_child")
_PATIENCE = 60.0  # seconds that the self-test may take; two are plenty on two cores
_OPENGL = f"OpenGL {VERSION[0]}.{VERSION[1]}"
_WHY = {
    "gl": f"the first that makes an {_OPENGL} context",
    "ray": f"there is no {_OPENGL}, and rays can be traced",
}
_USES = {
    "ray": "to trace rays where there is no OpenGL, and to verify",
    "compressed": "to read Draco and meshopt meshes (meshoptimizer needs a C++ compiler)",
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
        "schema": SCHEMA,
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
    (answer,) = examine_all([_TRIAL], _PATIENCE)
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
