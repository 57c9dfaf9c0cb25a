"""What a batch says while it works."""

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

from aoprecalc import __version__
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options.fields import as_words
from aoprecalc.pipeline.jobs import Asset, Failure, JobSpec

Status = Literal["made", "unchanged", "cached", "failed", "stopped"]


@dataclass(frozen=True)
class AssetResult:
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


class BatchProgress:
    """Receives what a batch is doing; this base class looks on in silence."""

    def begin(self, total: int) -> None:
        """Begin with `total` assets."""

    def stage(self, asset: Asset, name: str) -> None:
        """See an asset come to a stage."""

    def end(self, result: AssetResult) -> None:
        """See what became of an asset; each has its turn once."""

    def note(self, text: str) -> None:
        """Hear a line about what was done beside the assets."""

    def warn(self, text: str) -> None:
        """Hear a line that the user should know about the batch as a whole."""


# The report of a batch, as one JSON document, and as a JUnit file.


def batch_report(results: Sequence[AssetResult], output: Path, seconds: float) -> dict[str, Any]:
    """Return the report; every value is a plain JSON value."""
    counts = Counter(result.status for result in results)
    report = {
        "schema": SCHEMAS["batch"],
        "version": __version__,
        "output": str(output),
        "counts": {name: counts[name] for name in ("made", "unchanged", "cached", "failed", "stopped")},
        "assets": [_asset(result, output) for result in results],
        "seconds": round(seconds, 3),
    }
    return {key: _legible(value) for key, value in report.items()}


def junit(results: Sequence[AssetResult], seconds: float) -> str:
    """Return a JUnit file: a test case for each asset, in the suite of its folder.

    What was not begun counts as skipped.
    """
    failed = sum(result.status == "failed" for result in results)
    skipped = sum(result.status == "stopped" for result in results)
    counts: dict[str, Any] = {
        "tests": str(len(results)),
        "failures": str(failed),
        "errors": "0",
        "skipped": str(skipped),
    }
    suite = ElementTree.Element("testsuite", name="aoprecalc batch", **counts, time=f"{seconds:.3f}")
    for result in results:
        place: dict[str, Any] = {
            "classname": _xml_text(result.asset.folder).replace("/", ".") or "assets",
            "name": _xml_text(result.asset.stem),
            "file": _xml_text(str(result.asset.mesh)),
        }
        case = ElementTree.SubElement(suite, "testcase", **place, time=f"{result.seconds:.3f}")
        if result.failure is not None and result.status == "failed":
            failure = ElementTree.SubElement(
                case, "failure", type=result.failure.kind, message=_xml_text(result.failure.message)
            )
            failure.text = _xml_text("\n".join(filter(None, [*commands(result), result.failure.details])))
        elif result.status == "stopped":
            ElementTree.SubElement(case, "skipped", message="the batch was stopped")
        elif lines := (result.summary or {}).get("warnings"):
            ElementTree.SubElement(case, "system-out").text = _xml_text("\n".join(lines))
    suites = ElementTree.Element("testsuites", **counts, time=f"{seconds:.3f}")
    suites.append(suite)
    ElementTree.indent(suites)
    return ElementTree.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"


def commands(result: AssetResult) -> list[str]:
    """Return the commands that make an asset by itself, to see how it fails."""
    spec, mesh, stem = result.asset.spec, str(result.asset.mesh), result.asset.stem
    named = ["--", mesh] if mesh.startswith("-") else [mesh]
    lines = []
    if spec.bake is not None:
        words = as_words(spec.bake)
        words += ["-o", f"{stem}_ao{spec.texture_suffix}"] if spec.texture_suffix != JobSpec.texture_suffix else []
        words += ["--mesh-output", f"{stem}_ao{spec.mesh_suffix}"] if spec.mesh_suffix != JobSpec.mesh_suffix else []
        words += ["--verify"] if spec.verify else []
        lines.append(shlex.join(["aoprecalc", "bake", *words, *named]))
    if spec.spheres is not None:
        words = as_words(spec.spheres)
        words += ["-o", f"{stem}_spheres{spec.spheres_suffix}"] if spec.spheres_suffix != JobSpec.spheres_suffix else []
        lines.append(shlex.join(["aoprecalc", "spheres", *words, *named]))
    return lines


def _asset(result: AssetResult, output: Path) -> dict[str, Any]:
    failure = result.failure
    error = None
    if failure is not None:
        error = {"kind": failure.kind, "message": failure.message, "exit_code": failure.exit_code}
    return {
        "name": result.asset.name,
        "path": str(result.asset.mesh),
        "status": result.status,
        "outputs": [str(output / result.asset.folder / name) for name in result.outputs],
        "summary": result.summary,
        "error": error,
        "commands": commands(result),
        "seconds": round(result.seconds, 3),
    }


def _legible(value: Any) -> Any:
    """Return a JSON value without the bytes of file names that are no text."""
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    if isinstance(value, list):
        return [_legible(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _legible(entry) for key, entry in value.items()}
    return value


def _xml_text(text: str) -> str:
    """Return a text without what XML cannot hold."""
    return "".join(
        char if char in "\t\n" or " " <= char < "\ud800" or "\ue000" <= char < "\ufffe" else "?" for char in text
    )
