"""`aoprecalc doctor`."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from aoprecalc.cli.commands import Command
from aoprecalc.cli.options import Console, output_options, say
from aoprecalc.errors import AoprecalcError, RendererError

if TYPE_CHECKING:
    from aoprecalc.api.doctor import DoctorReport, RendererStatus


@click.command(cls=Command, short_help="Print what works on this machine, and what to install.")
@output_options
def doctor(*, quiet: bool, verbose: bool, as_json: bool) -> None:
    """Print which renderers work on this machine, test one by a small bake, and print what to install."""
    from aoprecalc.api.doctor import doctor
    from aoprecalc.io.outputs import json_text

    report = doctor(progress=Console(quiet=quiet, verbose=verbose))
    if as_json:
        click.echo(json_text(report.to_dict()), nl=False)
    else:
        say(*_table(report))
    if report.auto is None:
        # Without any renderer OpenGL and rays are the first two things to install.
        names = ", ".join(renderer.name for renderer in report.renderers)
        lines = ", ".join(
            f"`{line}`{_where(system)}" for hint in report.install[:2] for system, line in hint.lines.items()
        )
        raise RendererError(f"no way to render: none of {names} works; install one of them: {lines}")
    if report.self_test is not None and not report.passed:
        test = report.self_test
        result = test.fault or f"its RMS error is {test.error:.4f}, at most {test.allowed:g} was expected"
        instead = "try --backend ray" if report.auto.backend == "gl" else "install OpenGL"
        raise AoprecalcError(f"the self-test failed with {report.auto.name} ({result}); {instead}, or another driver")


def _table(report: "DoctorReport") -> list[str]:
    """Lay out the report: what renders, what a bake takes and how well, versions, and what to install."""
    machine = report.machine
    cores = f"{machine.cores:g} core{'' if machine.cores == 1 else 's'}"
    memory = "" if machine.memory is None else f", {machine.memory / 1024**3:.1f} GiB of memory"
    lines = [
        f"aoprecalc {report.version}, Python {machine.python}, {cores}{memory}",
        machine.platform,
        "",
        "renderers, in the order in which --backend auto tries them",
        *_columns((entry.name, "works" if entry.works else "no", _about(entry)) for entry in report.renderers),
        "",
        "self-test",
        *_columns(_self_test(report)),
        "",
        "libraries",
        *_columns(_libraries(report)),
    ]
    if report.environment:
        lines += ["", "environment", *_columns(report.environment.items())]
    if report.install:
        lines += ["", "what to install"]
    for hint in report.install:
        lines.append(f"  {hint.what}: {hint.purpose}")
        rows = _columns((line, _where(system)) for system, line in hint.lines.items())
        lines += [f"    {row}" for row in rows]
    return lines


def _about(entry: "RendererStatus") -> str:
    """Say what a renderer is, or why it does not work."""
    if not entry.works:
        return str(entry.fault)
    if entry.backend == "ray":
        return f"embreex {entry.version}"
    kind, size = "software" if entry.software else "hardware", entry.max_texture_size
    return f"{entry.renderer}, {kind}; OpenGL {entry.version}; textures up to {size} x {size}"


def _self_test(report: "DoctorReport") -> list[tuple[str, str]]:
    """Say what a bake takes, and how the small one went."""
    choice, test = report.auto, report.self_test
    if choice is None or test is None:
        return [("--backend auto", "takes nothing: nothing renders")]
    taken = ("--backend auto", f"takes {choice.name}: {choice.why}")
    if test.fault is not None:
        return [taken, ("a small bake", f"failed: {test.fault}")]
    verdict = "passed" if test.passed else "failed"
    error = f"RMS error {test.error:.4f}, at most {test.allowed:g} is expected"
    return [taken, ("a small bake", f"{verdict}: {error}; {test.seconds:.1f} s")]


def _libraries(report: "DoctorReport") -> list[tuple[str, str, str]]:
    """Return name, version and the extra that brings it."""
    own = [(name, version, "") for name, version in report.libraries.items()]
    extras = [
        (name, version, f"(extra {extra})")
        for extra, packages in report.extras.items()
        for name, version in packages.items()
    ]
    return [(name, version or "not installed", note) for name, version, note in own + extras]


def _where(system: str) -> str:
    return "" if system == "any" else f" ({system})"


def _columns(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Align rows of words."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)) for row in rows)
    return [f"  {line.rstrip()}" for line in lines]
