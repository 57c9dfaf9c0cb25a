"""The report page: one HTML file with everything in it, from what is told of each asset.

The templates are in the folder `report`; `page.html.j2` lists the ids and attributes that scripts and tests rely on.
"""

import base64
import hashlib
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aoprecalc import __version__
from aoprecalc.errors import counted
from aoprecalc.render.comparison import SATURATION_ERROR
from aoprecalc.types import Picture

Status = Literal["made", "unchanged", "cached", "read", "failed", "stopped", "unreadable", "removed"]
Change = Literal["added", "removed", "changed", "same", ""]

FAILED: tuple[Status, ...] = ("failed", "unreadable")
HISTOGRAM_BINS = 40

_QUALITY, _EFFORT = 82, 4  # of lossy WebP, out of 100 and 6
_FOLDER = Path(__file__).parent / "report"
# Figures that the table has, where any asset has them.
_COLUMNS = ("triangles", "mean", "error", "estimate", "iou", "seconds")


@dataclass(frozen=True)
class Budget:
    """How much of each asset a page holds, so that it stays small and quick.

    assets      the most that it is for
    texture     pixels on the longer side of a texture, and of the layout of its charts
    preview     width of a still picture in pixels; its height is three quarters of it
    thumbnail   width of the picture in the table
    triangles   of the 3D view; 0: none
    """

    assets: int
    texture: int
    preview: int
    thumbnail: int
    triangles: int


# Measured: a page of 100 assets has about 20 MB, one of 1,000 about 60 MB.
_BUDGETS = (
    Budget(3, 1024, 960, 96, 60_000),
    Budget(12, 768, 800, 96, 30_000),
    Budget(40, 512, 640, 96, 10_000),
    Budget(120, 384, 480, 72, 6_000),
    Budget(400, 192, 320, 64, 800),
    Budget(1 << 31, 96, 200, 48, 0),
)


def budget_for(assets: int) -> Budget:
    """Return the budget of a page of that many assets."""
    return next(budget for budget in _BUDGETS if assets <= budget.assets)


@dataclass(frozen=True)
class WebPicture:
    """A picture as the page shows it.

    source          data URL
    width, height   in pixels
    alt             says what is on it, for those who cannot see it
    """

    source: str
    width: int
    height: int
    alt: str


def web_picture(picture: Picture, alt: str, max_side: int, *, lossless: bool = False) -> WebPicture:
    """Encode a picture, (h, w) grey or (h, w, 3) sRGB uint8, reduced to `max_side` pixels on its longer side.

    Equal pictures give equal texts with the same libwebp.
    """
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(picture))
    share = min(1.0, max_side / max(image.size))
    size = tuple(max(1, round(side * share)) for side in image.size)
    if size != image.size:
        image = image.resize((size[0], size[1]), Image.Resampling.BOX, reducing_gap=None)
    buffer = io.BytesIO()
    image.convert("RGB").save(buffer, "WEBP", quality=_QUALITY, method=_EFFORT, lossless=lossless)
    text = base64.b64encode(buffer.getvalue()).decode()
    return WebPicture(f"data:image/webp;base64,{text}", size[0], size[1], alt)


@dataclass(frozen=True)
class Figure:
    """A number that is told of an asset.

    key     its column in the table, if it has one
    text    the number as it is read, with its unit
    value   by which the table is sorted
    """

    key: str
    label: str
    text: str
    value: float


@dataclass(frozen=True)
class Choice:
    """What was chosen, and why, in words."""

    topic: str
    chosen: str
    why: str = ""


@dataclass(frozen=True)
class Table:
    """A table of texts; the first cell of a row is its heading.

    key       part of its id
    numbers   all other cells are numbers
    """

    key: str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: bool = False


@dataclass(frozen=True)
class Histogram:
    """How often the values of a texture occur: counts in equal bins of [0, 1], mean and median."""

    counts: tuple[int, ...]
    mean: float
    median: float


@dataclass(frozen=True)
class Still:
    """A still picture of the mesh: `mode` is that of the 3D view which it stands for."""

    mode: str
    picture: WebPicture


@dataclass(frozen=True)
class Slider:
    """Two pictures of one thing, of the run before and of this one."""

    label: str
    before: WebPicture
    after: WebPicture


@dataclass(frozen=True)
class Comparison:
    """What has changed since the run before: a sentence, pictures, figures, options."""

    answer: str
    sliders: tuple[Slider, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class AssetPage:
    """What the page tells of one asset.

    error        why it failed, or cannot be shown; empty if it can
    missing      what is not there, and why
    view         plain JSON for the 3D view, without the pictures that the page shows anyway; None without one
    view_note    why there is no 3D view
    """

    name: str
    status: Status
    path: str = ""
    change: Change = ""
    error: str = ""
    figures: tuple[Figure, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    thumbnail: WebPicture | None = None
    texture: WebPicture | None = None
    layout: WebPicture | None = None
    heat_map: WebPicture | None = None
    stills: tuple[Still, ...] = ()
    view: dict[str, Any] | None = None
    view_note: str = ""
    histogram: Histogram | None = None
    stages: tuple[tuple[str, float], ...] = ()
    choices: tuple[Choice, ...] = ()
    tables: tuple[Table, ...] = ()
    comparison: Comparison | None = None
    commands: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()

    @property
    def rank(self) -> tuple[int, str]:
        """Where it stands in the table: failures, changes, warnings, the others; by name among equals."""
        order = (
            self.status in FAILED,
            self.status == "stopped",
            self.change in ("added", "removed", "changed"),
            bool(self.warnings),
            True,
        )
        return order.index(True), self.name

    @property
    def brief(self) -> str:
        """What a narrow table tells in one line instead of its columns."""
        found = [f"mean AO {mean.text}"] if (mean := self.figure("mean")) else []
        found += [f"RMS error {error.text}"] if (error := self.figure("error")) else []
        found += [counted(len(self.warnings), "warning")] if self.warnings else []
        return ", ".join(found)

    def figure(self, key: str) -> Figure | None:
        """Return a figure by its key."""
        return next((figure for figure in self.figures if figure.key == key), None)


@dataclass(frozen=True)
class Page:
    """A finished page: its HTML, its assets in the order of the table, and whether it has 3D views."""

    html: str
    title: str
    assets: tuple[AssetPage, ...]
    interactive: bool


def render_page(assets: Sequence[AssetPage], title: str, *, before: str = "", viewer: str = "") -> Page:
    """Return the page of a report.

    before   what the assets are compared with, in words; empty: with nothing
    viewer   JavaScript that defines AoView (see `viewer/mesh_view.js`); empty: the page has still pictures only

    Nothing is fetched from anywhere: a content security policy allows the page's own scripts and styles alone, by their
    hashes. Equal arguments give equal texts.
    """
    ordered = sorted(assets, key=lambda asset: asset.rank)
    if not viewer:
        ordered = [replace(asset, view=None) for asset in ordered]
    if not any(asset.view for asset in ordered):
        viewer = ""
    style, script = _own("report.css"), _own("report.js")
    scripts = [script, *([_harmless(viewer)] if viewer else [])]
    policy = (
        f"default-src 'none'; img-src data: blob:; style-src {_hash(style)}; "
        f"script-src {' '.join(map(_hash, scripts))}; base-uri 'none'; form-action 'none'"
    )
    columns = {
        key: next(figure.label for asset in ordered if (figure := asset.figure(key)))
        for key in _COLUMNS
        if any(asset.figure(key) for asset in ordered)
    }
    if "error" in columns:  # which tells more than its estimate
        columns.pop("estimate", None)
    html = (
        _environment()
        .get_template("page.html.j2")
        .render(
            title=title,
            assets=ordered,
            columns=columns,
            has_status=any(asset.status != "read" or asset.change for asset in ordered),
            filters=_filters(ordered),
            summary=_summary(ordered),
            before=before,
            policy=policy,
            style=style,
            script=script,
            viewer=scripts[1] if viewer else "",
            version=__version__,
            full_colour=f"{SATURATION_ERROR:g}",
        )
    )
    return Page(html, title, tuple(ordered), interactive=any(asset.view is not None for asset in ordered))


def _summary(assets: Sequence[AssetPage]) -> str:
    """Return how many assets there are, and of which status."""
    counts = Counter(asset.status for asset in assets if asset.status != "read")
    parts = [f"{count} {status}" for status, count in counts.items()]
    warned = sum(bool(asset.warnings) for asset in assets)
    parts += [f"{warned} with warnings"] if warned else []
    found = counted(len(assets), "asset")
    return f"{found}: {', '.join(parts)}" if parts else found


def _filters(assets: Sequence[AssetPage]) -> list[tuple[str, str, int]]:
    """Return the filters of the table: key, label, number of assets; none that has no asset."""
    changes = Counter(asset.change for asset in assets)
    filters = [
        ("failed", "Failed", sum(asset.status in (*FAILED, "stopped") for asset in assets)),
        *((change, change.capitalize(), changes[change]) for change in ("added", "removed", "changed")),
        ("warnings", "With warnings", sum(bool(asset.warnings) for asset in assets)),
    ]
    return [("all", "All", len(assets)), *(entry for entry in filters if entry[2])]


@cache
def _environment() -> Any:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _own(name: str) -> Any:
    """Return a file of the page's folder as markup that is not escaped."""
    from markupsafe import Markup

    return Markup((_FOLDER / name).read_text(encoding="utf-8").strip())


def _harmless(script: str) -> Any:
    """Return JavaScript as markup, without what would end the element that holds it; strings keep their meaning."""
    from markupsafe import Markup

    script = script.replace("\r\n", "\n").strip().replace("<!--", "<\\!--")
    return Markup(re.sub("</(?=script)", r"<\\/", script, flags=re.IGNORECASE))


def _hash(text: str) -> str:
    """Return the source expression of an inline script or style for a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
