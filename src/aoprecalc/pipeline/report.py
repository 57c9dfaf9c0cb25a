"""The result of each asset, progress of a batch, and its reports: JSON and JUnit."""

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args
from xml.etree import ElementTree

from aoprecalc.api.documents import Document, Report
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options.fields import as_words
from aoprecalc.pipeline.jobs import Asset, Failure, FailureKind, JobSpec

Status = Literal["made", "unchanged", "cached", "failed", "stopped"]


@dataclass(frozen=True)
class AssetResult:
    """The result of one asset of a batch.

    Attributes
    ----------
    asset : Asset
        Its `name`, `mesh` (a path) and `spec`.
    status : {"made", "unchanged", "cached", "failed", "stopped"}
        Made now; up to date already; taken from the cache; failed; not begun or not finished when the batch ended.
    outputs : tuple of str
        Names of its files in its folder, sorted.
    summary : dict or None
        Plain JSON values such as `triangles`, `ao_mean`, `spheres`, `warnings`; None if nothing was made.
    failure : Failure or None
        Why it failed: `kind`, `message`, `exit_code`.
    seconds : float
        How long it took.

    """

    asset: Asset
    status: Status
    outputs: tuple[str, ...] = ()
    summary: dict[str, Any] | None = None
    failure: Failure | None = None
    seconds: float = 0.0


class BatchProgress:
    """Receives the progress of a batch; this base class ignores it. Derive from it and override what you need."""

    def begin(self, total: int) -> None:
        """Begin a batch of `total` assets."""

    def stage(self, asset: Asset, name: str) -> None:
        """Note that an asset has begun a stage."""

    def end(self, result: AssetResult) -> None:
        """Note the result of an asset; called once for each asset."""

    def note(self, text: str) -> None:
        """Receive a line of information about the batch as a whole."""

    def warn(self, text: str) -> None:
        """Receive a warning about the batch as a whole."""


@dataclass(frozen=True)
class BatchCounts(Report):
    """How many assets have each status."""

    made: int
    unchanged: int
    cached: int
    failed: int
    stopped: int


@dataclass(frozen=True)
class AssetError(Report):
    """Why an asset was not made."""

    kind: FailureKind
    message: str
    exit_code: int


@dataclass(frozen=True)
class AssetReport(Report):
    """The result of one asset: see `AssetResult`; `commands` make it without the batch."""

    name: str
    path: str
    status: Status
    outputs: tuple[str, ...]
    summary: dict[str, Any] | None
    error: AssetError | None
    commands: tuple[str, ...]
    seconds: float


@dataclass(frozen=True)
class BatchReport(Document):
    """What a batch made.

    Attributes
    ----------
    output : str
        The folder of the results.
    counts : BatchCounts
        Number of assets `made`, `unchanged`, `cached`, `failed` and `stopped`.
    assets : tuple of AssetReport
        Each with `name`, `path` of the mesh, `status`, paths of its `outputs`, `summary`, `error`, `commands` that
        make it without the batch, and `seconds`.
    seconds : float
    """

    schema: int = field(default=SCHEMAS["batch"], kw_only=True)
    output: str
    counts: BatchCounts
    assets: tuple[AssetReport, ...]
    seconds: float

    @classmethod
    def of(cls, results: Sequence[AssetResult], output: Path, seconds: float) -> "BatchReport":
        """Return the report of results."""
        counts = Counter(result.status for result in results)
        assets = tuple(_asset_report(result, output) for result in results)
        return cls(
            str(output), BatchCounts(**{name: counts[name] for name in get_args(Status)}), assets, round(seconds, 3)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document; texts that cannot be encoded have ? for what cannot."""
        return {key: _printable(value) for key, value in super().to_dict().items()}


def junit(results: Sequence[AssetResult], seconds: float) -> str:
    """Return a JUnit file: a test case for each asset, whose class is the asset's folder.

    Stopped assets count as skipped.
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
        attributes: dict[str, Any] = {
            "classname": _xml_text(result.asset.folder).replace("/", ".") or "assets",
            "name": _xml_text(result.asset.stem),
            "file": _xml_text(str(result.asset.mesh)),
        }
        case = ElementTree.SubElement(suite, "testcase", **attributes, time=f"{result.seconds:.3f}")
        if result.failure is not None and result.status == "failed":
            failure = ElementTree.SubElement(
                case, "failure", type=result.failure.kind, message=_xml_text(result.failure.message)
            )
            failure.text = _xml_text("\n".join(filter(None, [*reproduce_commands(result), result.failure.details])))
        elif result.status == "stopped":
            ElementTree.SubElement(case, "skipped", message="the batch was stopped")
        elif lines := (result.summary or {}).get("warnings"):
            ElementTree.SubElement(case, "system-out").text = _xml_text("\n".join(lines))
    suites = ElementTree.Element("testsuites", **counts, time=f"{seconds:.3f}")
    suites.append(suite)
    ElementTree.indent(suites)
    return ElementTree.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"


def reproduce_commands(result: AssetResult) -> list[str]:
    """Return the command lines that make one asset without the batch, to reproduce a failure."""
    spec, mesh, stem = result.asset.spec, str(result.asset.mesh), result.asset.stem
    arguments = ["--", mesh] if mesh.startswith("-") else [mesh]
    lines = []
    if spec.bake is not None:
        words = as_words(spec.bake)
        words += _output_words(f"{stem}_ao", spec.bake_output, JobSpec.bake_output)
        words += ["--verify"] if spec.verify else []
        words += ["--bent-normals", f"{stem}_bent{spec.bent_normals}"] if spec.bent_normals else []
        words += ["--sh", f"{stem}_sh{spec.sh}"] if spec.sh else []
        lines.append(shlex.join(["aoprecalc", "bake", *words, *arguments]))
    if spec.spheres is not None:
        words = as_words(spec.spheres)
        words += _output_words(f"{stem}_spheres", spec.spheres_output, JobSpec.spheres_output)
        lines.append(shlex.join(["aoprecalc", "spheres", *words, *arguments]))
    return lines


def _output_words(stem: str, suffixes: tuple[str, ...], default: tuple[str, ...]) -> list[str]:
    """Return the options -o that name files with these extensions; none for the default."""
    return [word for suffix in suffixes for word in ("-o", f"{stem}{suffix}")] if suffixes != default else []


def _asset_report(result: AssetResult, output: Path) -> AssetReport:
    asset, failure = result.asset, result.failure
    return AssetReport(
        asset.name,
        str(asset.mesh),
        result.status,
        tuple(str(output / asset.folder / name) for name in result.outputs),
        result.summary,
        None if failure is None else AssetError(failure.kind, failure.message, failure.exit_code),
        tuple(reproduce_commands(result)),
        round(result.seconds, 3),
    )


def _printable(value: Any) -> Any:
    """Return a JSON value whose texts can be encoded: file names may hold bytes that are no characters."""
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    if isinstance(value, list):
        return [_printable(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _printable(entry) for key, entry in value.items()}
    return value


def _xml_text(text: str) -> str:
    """Return a text with ? for each character that XML does not allow."""
    return "".join(
        char if char in "\t\n" or " " <= char < "\ud800" or "\ue000" <= char < "\ufffe" else "?" for char in text
    )
