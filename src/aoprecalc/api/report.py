"""The report page of results: read them, draw what they hold, and write one HTML file."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Literal

from aoprecalc.api.documents import Document, Report
from aoprecalc.api.report_assets import EXPECTED, AssetFiles, Result, collect_assets
from aoprecalc.api.report_contents import ReadAsset, asset_page, read_asset
from aoprecalc.api.report_facts import changes
from aoprecalc.errors import InputError, OutputError, UsageError, counted
from aoprecalc.io import Outputs
from aoprecalc.io.outputs import SCHEMAS, claim_output, output_path
from aoprecalc.progress import Progress
from aoprecalc.render.report_page import (
    AssetPage,
    Budget,
    Page,
    Status,
    budget_for,
    render_page,
)
from aoprecalc.render.view_geometry import viewer_script


@dataclass(frozen=True)
class ReportedAsset(Report):
    """An asset of a page.

    status    that of its batch; read where no batch made it, unreadable where its files cannot be read, and removed
              where only the run before has it
    change    added, removed, changed or same since the run before; None where nothing was compared
    warnings  their number
    """

    name: str
    status: Status
    change: Literal["added", "removed", "changed", "same"] | None
    warnings: int


@dataclass(frozen=True)
class PageReport(Document):
    """What `aoprecalc report` has written.

    Attributes
    ----------
    output : str
        Path of the page.
    bytes : int
        Its size.
    title : str
    interactive : bool
        It has 3D views; otherwise still pictures only.
    assets : tuple of ReportedAsset
        In the order of the page's table: failures first.
    """

    schema: int = field(default=SCHEMAS["report"], kw_only=True)
    output: str
    bytes: int
    title: str
    interactive: bool
    assets: tuple[ReportedAsset, ...]

    @property
    def path(self) -> Path:
        """Path of the page."""
        return Path(self.output)


_TITLE = "Ambient occlusion report"


def write_report(
    results: Result | Sequence[Result],
    output: str | PathLike[str] | None = None,
    *,
    before: Result | Sequence[Result] | None = None,
    title: str | None = None,
    progress: Progress | None = None,
) -> PageReport:
    """Write a page that shows results in a browser: one HTML file that needs no network.

    For each asset: texture, charts, a 3D view, histogram, seconds, warnings, what was chosen and why. For several, a
    table that can be sorted and searched, failures first.

    Parameters
    ----------
    results : path, report, or sequence of them
        Meshes that `bake` wrote, their textures, sphere sets, reports of bake, verify or batch (files, or
        `BakeReport`, `VerifyReport`, `BatchReport`), or folders of them, which are searched recursively.
    output : path, optional
        The file, ``report.html`` by default, or a folder for it.
    before : path, report, or sequence of them, optional
        The results of another run, to compare with.
    title : str, optional
        Heading of the page.
    progress : Progress, optional
        Receives the stages.

    Returns
    -------
    PageReport
        Its `path`, and the assets on it.

    Raises
    ------
    InputError
        If a result is missing, is no result or cannot be read. What cannot be read below a folder is told on the page.
    UsageError
        If the output's extension is not that of HTML.
    OutputError
        If the file cannot be written.
    """
    path = page_path(output, "report.html")
    with Outputs() as outputs:
        claim_output(outputs, output, path)
        return write_page(outputs, path, results, before=before, title=title, progress=progress)


def page_path(output: str | PathLike[str] | None, default: str) -> Path:
    """Return the path of a page; raises UsageError where its extension is not that of HTML."""
    path = output_path(output, default)
    if path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{path}: has the extension {path.suffix or '(none)'}; .html or a folder was expected")
    return path


def write_page(
    outputs: Outputs,
    path: Path,
    results: Result | Sequence[Result],
    *,
    before: Result | Sequence[Result] | None = None,
    title: str | None = None,
    progress: Progress | None = None,
) -> PageReport:
    """Write the page of results as one of several outputs; see `write_report`."""
    page = read_page(results, before=before, title=title, progress=progress or Progress())
    data = page.html.encode(errors="replace")
    try:
        outputs.path(path).write_bytes(data)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error
    assets = [
        ReportedAsset(asset.name, asset.status, asset.change or None, len(asset.warnings)) for asset in page.assets
    ]
    return PageReport(str(path), len(data), page.title, page.interactive, tuple(assets))


def read_page(
    results: Result | Sequence[Result],
    *,
    before: Result | Sequence[Result] | None,
    title: str | None,
    progress: Progress,
) -> Page:
    """Read results, and return their page."""
    assets = collect_assets(results)
    earlier = {} if before is None else {asset.name: asset for asset in collect_assets(before, "before")}
    if len(assets) == len(earlier) == 1:  # one asset is compared with one, whatever they are called
        earlier = {assets[0].name: next(iter(earlier.values()))}
    present = {asset.name for asset in assets}
    removed = [asset for name, asset in earlier.items() if name not in present]
    budget = budget_for(len(assets) + len(removed))
    pages, script = [], viewer_script() or ""
    with progress.stage("draw", len(assets), "assets"):
        for asset in assets:
            shown = read_asset(asset)
            if shown is not None:
                page = asset_page(shown, budget, interactive=bool(script))
                if before is not None:
                    page = _compared(page, shown, earlier.get(asset.name), budget)
                pages.append(page)
            progress.advance()
    if not pages:
        raise InputError(
            f"{_named(results)}: none of {counted(len(assets), 'mesh', 'meshes')} has ambient occlusion; {EXPECTED}"
        )
    pages += [_removed(asset, budget) for asset in removed]
    heading = title or (f"{pages[0].name}: ambient occlusion" if len(pages) == 1 else _TITLE)
    return render_page(pages, heading, before="" if before is None else _named(before), viewer=script)


def _compared(page: AssetPage, read: ReadAsset, earlier: AssetFiles | None, budget: Budget) -> AssetPage:
    """Return a page with what has changed since the run before; None: it had no such asset."""
    old = None if earlier is None else read_asset(replace(earlier, given=False))
    if earlier is None or old is None:
        return replace(page, change="added")
    change, comparison = changes(earlier, asset_page(old, budget), read.files, page)
    return replace(page, change=change, comparison=comparison)


def _removed(asset: AssetFiles, budget: Budget) -> AssetPage:
    """Return the page of an asset that only the run before has."""
    old = read_asset(replace(asset, given=False))
    page = AssetPage(asset.name, "removed") if old is None else asset_page(old, budget)
    note = "Only the run before has it; this is what it was."
    return replace(page, status="removed", change="removed", notes=(note, *page.notes), view_note="Still pictures.")


def _named(results: Result | Sequence[Result]) -> str:
    """Return results as a message names them."""
    several = results if isinstance(results, list | tuple) else [results]
    return ", ".join(str(r) if isinstance(r, str | PathLike) else f"a {type(r).__name__}" for r in several)
