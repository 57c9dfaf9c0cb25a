"""Doctor: what this machine can bake with, whether a small bake comes out right, and what to install.

Each renderer is tried in a process of its own, which it may crash or hang.
"""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event
from typing import Any

from aoprecalc.api.documents import OMIT_NONE, Document, Report
from aoprecalc.gl.context import CANDIDATES, INSTALLS, VERSION, Candidate
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.progress import Progress, StageTimer
from aoprecalc.subprocesses import ChildStoppedError, ChildTimeoutError, ask, command
from aoprecalc.system import EXTRAS, LIBRARIES, environment, has_headless_opengl, machine, versions
from aoprecalc.visibility.embree import casts_packets

PROBE_SECONDS = 20.0  # that a probe may take; it needs a tenth of one


@dataclass(frozen=True)
class ProbeAnswer:
    """The answer of a probe.

    facts     properties of the renderer; empty if it does not work
    fault     why it does not work; empty if it does
    crashed   its process crashed or hung, as a bake with it would
    """

    facts: dict[str, Any] = field(default_factory=dict)
    fault: str = ""
    crashed: bool = False

    @property
    def works(self) -> bool:
        """Whether the renderer works."""
        return not self.fault


@dataclass(frozen=True)
class ProbeResults:
    """The answers of all renderers: OpenGL contexts, in the order in which a bake tries them, and ray tracing."""

    opengl: tuple[tuple[Candidate, ProbeAnswer], ...]
    rays: ProbeAnswer


def probe_all() -> ProbeResults:
    """Probe every EGL device, OSMesa and Embree."""
    count, osmesa, rays = run_probes([_probe_command("count"), _probe_command("osmesa"), _probe_command("rays")])
    # If there is no device, the first one is probed anyway, for the reason that a bake would give.
    device_count = max(1, count.facts.get("devices", 1))
    devices = [candidate for candidate in CANDIDATES if candidate.kind == "egl"][:device_count]
    answers = run_probes([_probe_command("egl", str(candidate.device)) for candidate in devices])
    others = [(candidate, osmesa) for candidate in CANDIDATES if candidate.kind == "osmesa"]
    return ProbeResults((*zip(devices, answers, strict=True), *others), rays)


def run_probes(commands: Sequence[list[str]], timeout: float = PROBE_SECONDS) -> list[ProbeAnswer]:
    """Return the answer of each command; they run at the same time, and none runs on after this returns or raises."""
    stop = Event()
    with ThreadPoolExecutor(len(commands)) as pool:
        futures = [pool.submit(_probe, command, timeout, stop) for command in commands]
        try:
            return [future.result() for future in futures]
        finally:
            stop.set()  # Ctrl-C raises in this thread alone


def _probe(command: list[str], timeout: float, stop: Event) -> ProbeAnswer:
    """Return the answer of one probe: a line of JSON, the last on its standard output."""
    try:
        facts = json.loads(ask(command, timeout=timeout, stop=stop).splitlines()[-1])
    except ChildTimeoutError as error:
        return ProbeAnswer(fault=f"it hangs: {error}", crashed=True)
    except (ChildProcessError, ChildStoppedError) as error:
        return ProbeAnswer(fault=str(error), crashed=True)
    except (ValueError, IndexError):
        return ProbeAnswer(fault="it ended without an answer", crashed=True)
    fault = facts.get("fault", "")
    return ProbeAnswer({} if fault else facts, fault)


def _probe_command(*request: str) -> list[str]:
    return command("aoprecalc.api.checks", *request)


# The report.

_SELF_TEST = command("aoprecalc.api.checks", "self-test")
_SELF_TEST_SECONDS = 60.0  # that the self-test may take; two are plenty on two cores
_OPENGL = f"OpenGL {VERSION[0]}.{VERSION[1]}"
_WHY = {
    "gl": f"the first that makes an {_OPENGL} context",
    "ray": f"there is no {_OPENGL}, and rays can be traced",
}
_FASTER = "with --directions auto rays are faster than OpenGL on a processor; for a number of directions: {}"
_SIMPLIFIER = "opengl_decimate"
_USES = {
    "DracoPy": "to read glTF meshes compressed with Draco",
    "meshoptimizer": "to read glTF meshes compressed with meshopt (its installation needs a C++ compiler)",
    "formats": "to read COLLADA and 3MF",
    "usd": "to read and write USD",
    "fbx": "to read FBX",
    "cluster": "to share batches among machines",
}


@dataclass(frozen=True)
class Machine(Report):
    """What runs aoprecalc; `cores` and `memory` (bytes; None where it is not known) are what a container allows."""

    python: str
    platform: str
    cores: float
    memory: int | None


@dataclass(frozen=True)
class RendererStatus(Report):
    """A renderer: why it does not work (`fault`), or what it says of itself; `software` has no GPU."""

    name: str
    backend: str
    works: bool
    fault: str | None
    renderer: str | None = field(default=None, metadata=OMIT_NONE)
    vendor: str | None = field(default=None, metadata=OMIT_NONE)
    version: str | None = field(default=None, metadata=OMIT_NONE)
    software: bool | None = field(default=None, metadata=OMIT_NONE)
    max_texture_size: int | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True)
class RendererChoice(Report):
    """The renderer that a bake takes, and why."""

    name: str
    backend: str
    why: str


@dataclass(frozen=True)
class SelfTestResult(Report):
    """A small bake: its RMS error and the greatest that passes, or why it could not be measured (`fault`)."""

    passed: bool
    backend: str | None = field(default=None, metadata=OMIT_NONE)
    renderer: str | None = field(default=None, metadata=OMIT_NONE)
    error: float | None = field(default=None, metadata=OMIT_NONE)
    allowed: float | None = field(default=None, metadata=OMIT_NONE)
    seconds: float | None = field(default=None, metadata=OMIT_NONE)
    fault: str | None = None


@dataclass(frozen=True)
class InstallHint(Report):
    """Something that is missing, what for, and by system (or ``"any"``) the line that installs it."""

    what: str
    purpose: str = field(metadata={"key": "for"})
    lines: dict[str, str]


@dataclass(frozen=True)
class DoctorReport(Document):
    """What this machine can bake with.

    Attributes
    ----------
    machine : Machine
    environment : dict of str to str
        Variables that steer drivers and loaders.
    renderers : tuple of RendererStatus
        In the order in which a bake tries them.
    auto : RendererChoice or None
        The one that a bake takes; None where none works.
    self_test : SelfTestResult or None
        None where nothing renders.
    libraries : dict of str to str or None
        Versions; None where one is not installed.
    extras : dict of str to dict
        The same of each optional extra.
    install : tuple of InstallHint
    passed : bool
        The self-test passed.
    seconds : dict of str to float
        Per stage, and ``"total"``.
    """

    schema: int = field(default=SCHEMAS["doctor"], kw_only=True)
    machine: Machine
    environment: dict[str, str]
    renderers: tuple[RendererStatus, ...]
    auto: RendererChoice | None
    self_test: SelfTestResult | None
    libraries: dict[str, str | None]
    extras: dict[str, dict[str, str | None]]
    install: tuple[InstallHint, ...]
    passed: bool
    seconds: dict[str, float]


def doctor(*, progress: Progress | None = None) -> DoctorReport:
    """Try all renderers, bake a small scene with the one that a bake would take, and say what to install.

    Parameters
    ----------
    progress : Progress, optional
        Receives stages.

    Returns
    -------
    DoctorReport
        A broken driver, or a machine without any renderer, is not an error: the report says so.
    """
    timer = StageTimer(progress or Progress())
    with timer.stage("renderers"):
        probes = probe_all()
    choice, chosen = _choose(probes)
    self_test = None
    if choice is not None:
        with timer.stage("self-test"):
            self_test = _run_self_test() if chosen.works else SelfTestResult(passed=False, fault=chosen.fault)
    extras = {extra: versions(names) for extra, names in EXTRAS.items()}
    return DoctorReport(
        machine=Machine(**machine()),
        environment=environment(),
        renderers=tuple(
            RendererStatus(name, backend, answer.works, answer.fault or None, **answer.facts)
            for name, backend, answer in _renderers(probes)
        ),
        auto=choice,
        self_test=self_test,
        libraries=versions(LIBRARIES),
        extras=extras,
        install=tuple(_install_hints(probes, extras)),
        passed=self_test is not None and self_test.passed,
        seconds=timer.seconds(),
    )


def _renderers(probes: ProbeResults) -> list[tuple[str, str, ProbeAnswer]]:
    """Return (name, backend, answer) of all renderers, in the order in which --backend auto tries them."""
    return [*((candidate.name, "gl", answer) for candidate, answer in probes.opengl), ("Embree", "ray", probes.rays)]


def _choose(probes: ProbeResults) -> tuple[RendererChoice | None, ProbeAnswer]:
    """Return what --backend auto takes, and what its probe answered; None where nothing renders.

    A bake that comes to a driver that crashes or hangs goes no further, whatever works behind it.
    """
    for name, backend, answer in _renderers(probes):
        if answer.works and answer.facts.get("software") and backend == "gl" and probes.rays.works and casts_packets():
            return RendererChoice("Embree", "ray", _FASTER.format(name)), probes.rays
        if answer.works or answer.crashed:
            why = _WHY[backend] if answer.works else f"a bake tries it and gets no further ({answer.fault})"
            return RendererChoice(name, backend, why), answer
    return None, probes.rays


def _run_self_test() -> SelfTestResult:
    (answer,) = run_probes([_SELF_TEST], _SELF_TEST_SECONDS)
    return SelfTestResult(**{"passed": False, **answer.facts, "fault": answer.fault or None})


def _install_hints(probes: ProbeResults, extras: dict[str, dict[str, str | None]]) -> list[InstallHint]:
    hints = []
    if has_headless_opengl() and not any(answer.works for _, answer in probes.opengl):
        hints.append(
            InstallHint(
                _OPENGL, "to bake by depth maps, faster by a GPU or with a number of directions", INSTALLS.copy()
            )
        )
    if not probes.rays.works:
        hints.append(InstallHint("embreex", "to trace rays, and to verify", {"any": "pip install embreex"}))
    if versions((_SIMPLIFIER,))[_SIMPLIFIER] is None:
        purpose, lines = "to simplify large meshes for 3D views in reports", {"any": f"pip install {_SIMPLIFIER}"}
        hints.append(InstallHint(_SIMPLIFIER, purpose, lines))
    for extra, packages in extras.items():
        lacking = [name for name, version in packages.items() if version is None]
        lines = {"any": f"pip install 'aoprecalc[{extra}]'"}
        if extra in _USES and lacking:
            hints.append(InstallHint(", ".join(lacking), _USES[extra], lines))
        else:
            hints += [InstallHint(name, _USES[name], lines) for name in lacking]
    return hints
