"""The report page as a parser reads it: structure, names that are HTML, what it may load, equal bytes."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from aoprecalc.render import report_page
from aoprecalc.render.report_page import (
    AssetPage,
    Choice,
    Comparison,
    Figure,
    Histogram,
    Slider,
    Still,
    Table,
    budget_for,
    render_page,
    web_picture,
)

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(1)> \"quoted\" 'too' {{ 7 * 7 }} <!-- & &amp;"
VOID = {"meta", "link", "img", "input", "br", "hr"}
PICTURE = web_picture(np.arange(64 * 48 * 3, dtype=np.uint8).reshape(48, 64, 3), "a picture", 64)


class Elements(HTMLParser):
    """All elements of a page, each (name, attributes, names of those around it), and its texts by their element."""

    def __init__(self, html):
        super().__init__(convert_charrefs=True)
        self.found, self.texts, self.open = [], [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attributes):
        assert len(attributes) == len(dict(attributes)), tag
        self.found.append((tag, dict(attributes), tuple(name for name, _ in self.open)))
        if tag not in VOID:
            self.open.append((tag, dict(attributes)))

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> ends nothing"
        assert self.open.pop()[0] == tag

    def handle_data(self, text):
        if text.strip():
            self.texts.append((*self.open[-1], text))

    def all(self, tag):
        return [attributes for name, attributes, _ in self.found if name == tag]

    def texts_of(self, tag):
        return [text for name, _, text in self.texts if name == tag]


def figures(**values):
    return tuple(Figure(key, key.capitalize(), f"{value}", value) for key, value in values.items())


def whole(name):
    """An asset with everything that a page can show."""
    return AssetPage(
        name,
        "made",
        path=f"in/{name}.obj",
        change="changed",
        figures=figures(triangles=12, mean=0.5, error=0.01, iou=0.9, seconds=3.5),
        warnings=(f"{name} is warned of",),
        notes=(f"{name} is noted",),
        missing=("something is missing",),
        thumbnail=replace(PICTURE, alt=""),
        texture=PICTURE,
        layout=PICTURE,
        heat_map=PICTURE,
        stills=(Still("ao", PICTURE), Still("spheres", PICTURE)),
        view={"label": name, "geometry": {"data": "AAAA"}, "note": "turn it"},
        histogram=Histogram((0, 1, 3, 2), 0.6, 0.65),
        stages=(("load", 0.25), ("unwrap", 2.0)),
        choices=(Choice("UVs", "new ones", "as the file has none"),),
        tables=(Table("parts", "Parts", ("Part", "Role"), ((name, "baked"),)),),
        comparison=Comparison("It differs.", (Slider("Texture", PICTURE, PICTURE),)),
        commands=(f"aoprecalc bake '{name}'",),
        files=(("Mesh", f"out/{name}.glb"),),
    )


ASSETS = [
    whole("b"),
    AssetPage("quiet", "made", figures=figures(triangles=2)),
    AssetPage("a failure", "failed", error="it is damaged", commands=("aoprecalc bake it",)),
    whole("a"),
]


@pytest.fixture(scope="module")
def page():
    return render_page(ASSETS, "A title", before="earlier/", viewer="var AoView = {};")


def test_elements_nest_and_ids_are_unique(page):
    elements = Elements(page.html)
    assert elements.open == []
    ids = [attributes["id"] for _, attributes, _ in elements.found if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes, _ in elements.found:
        for reference in ("aria-labelledby", "for"):
            assert set(attributes.get(reference, "").split()) <= set(ids)
        if attributes.get("href", "").startswith("#"):
            assert attributes["href"][1:] in ids


def test_every_asset_is_in_the_table_failures_first(page):
    rows = [attributes for attributes in Elements(page.html).all("tr") if "data-asset" in attributes]
    assert [row["data-status"] for row in rows] == ["failed", "made", "made", "made"]
    assert [asset.name for asset in page.assets] == ["a failure", "a", "b", "quiet"]
    assert [row["data-asset"] for row in rows] == [f"asset-{number}" for number in (1, 2, 3, 4)]
    sections = [attributes for attributes in Elements(page.html).all("section") if attributes.get("class") == "asset"]
    assert [section["id"] for section in sections] == [row["data-asset"] for row in rows]


def test_columns_are_those_that_any_asset_has():
    columns = re.findall(r'data-column="(\w+)">', render_page(ASSETS, "t").html)
    assert list(dict.fromkeys(columns)) == [
        "name",
        "status",
        "triangles",
        "mean",
        "error",
        "iou",
        "seconds",
        "warnings",
    ]
    some = [AssetPage(name, "read", figures=figures(mean=0.5)) for name in "ab"]
    assert 'data-column="iou">' not in render_page(some, "t").html


def test_one_asset_needs_no_table():
    html = render_page([whole("a")], "t").html
    assert 'id="overview"' not in html
    assert 'id="asset-1"' in html


def test_every_picture_has_a_text_or_stands_beside_the_name(page):
    for tag, attributes, around in Elements(page.html).found:
        if tag == "img":
            assert attributes["src"].startswith("data:image/webp;base64,")
            assert bool(attributes["alt"]) == ("table" not in around)
        if tag == "svg":
            assert attributes.get("role") == "img" or attributes.get("aria-hidden") == "true"


def test_it_loads_nothing_and_allows_only_its_own_scripts_and_styles(page):
    elements = Elements(page.html)
    for _, attributes, _ in elements.found:
        assert not any(name.startswith("on") for name in attributes)
        assert "style" not in attributes
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("#", "data:"))
    policy = next(meta["content"] for meta in elements.all("meta") if meta.get("http-equiv"))
    assert policy.startswith("default-src 'none';")
    parts = {part.split()[0]: part.split()[1:] for part in policy.split(";")}
    assert parts["img-src"] == ["data:", "blob:"]
    for tag, directive in (("script", "script-src"), ("style", "style-src")):
        texts = [text for name, attributes, text in elements.texts if name == tag and "type" not in attributes]
        hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
        assert sorted(parts[directive]) == sorted(f"'sha256-{found}'" for found in hashes)
    code = page.html.replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert not re.search(r"(?<!sha256)https?://", code)


def test_names_that_are_html_stay_text():
    assets = [whole(HOSTILE), replace(whole("a"), error=HOSTILE, status="failed")]
    page = render_page(assets, HOSTILE, before=HOSTILE, viewer="var AoView;")
    elements, harmless = Elements(page.html), Elements(render_page([whole("x"), assets[1]], "t", viewer="v").html)
    for tag in ("script", "img", "section", "tr"):
        assert len(elements.all(tag)) == len(harmless.all(tag))
    assert HOSTILE in elements.texts_of("h1")
    assert HOSTILE in elements.texts_of("h2")
    assert "".join(elements.texts_of("title")).startswith(HOSTILE)
    views = [json.loads(text) for tag, attributes, text in elements.texts if "asset-2-view" in attributes.values()]
    assert views == [assets[0].view]


def test_data_of_the_view_come_back_as_they_were(page):
    found = [text for _, attributes, text in Elements(page.html).texts if attributes.get("type") == "application/json"]
    assert [json.loads(text) for text in found] == [asset.view for asset in page.assets if asset.view]
    assert page.interactive


def test_without_three_js_there_are_stills_and_no_data():
    page = render_page(ASSETS, "t")
    assert not page.interactive
    assert "application/json" not in page.html
    assert "<canvas" not in page.html
    assert page.html.count('data-still="ao"') == 2


def test_a_measured_error_replaces_its_estimate_in_the_table():
    estimated = AssetPage("a", "read", figures=(Figure("estimate", "Estimated error", "0.02", 0.02),))
    measured = AssetPage("b", "read", figures=(Figure("error", "RMS error", "0.01", 0.01),))
    for assets, shown in (([estimated, estimated], ["estimate"]), ([estimated, measured], ["error"])):
        headings = [attributes for tag, attributes, _ in Elements(render_page(assets, "t").html).found if tag == "th"]
        columns = [heading["data-column"] for heading in headings if "data-column" in heading]
        assert columns == ["name", *shown, "warnings"]


def test_a_script_cannot_end_its_element():
    script = "const a = '</script><b>'; const c = '<!--<script>';"
    page = render_page([whole("a")], "t", viewer=script)
    elements = Elements(page.html)
    assert len(elements.all("script")) == 3  # the page's, the data, this one
    assert "<!--" not in page.html  # behind it, and another <script>, the end of the element would not count
    assert elements.all("b") == []


def test_the_same_assets_give_the_same_page(page):
    assert render_page(ASSETS, "A title", before="earlier/", viewer="var AoView = {};").html == page.html
    assert render_page(ASSETS[::-1], "A title", before="earlier/", viewer="var AoView = {};").html == page.html


def test_the_histogram_says_its_quarters(page):
    described = [text for text in Elements(page.html).texts_of("desc") if "Mean" in text]
    words = " ".join(described[0].split())
    assert words.startswith("Mean 0.600, median 0.650. 0.0% of the surface's texels from 0.00 to 0.25.")
    assert "50.0% of the surface's texels from 0.50 to 0.75." in words
    bars = re.findall(r'<g class="bars">.*?</g>', page.html, re.DOTALL)
    heights = [float(height) for height in re.findall(r'height="([\d.]+)"', bars[0])]
    assert np.allclose(np.array(heights) / max(heights), [0, 1 / 3, 1, 2 / 3], atol=1e-3)


@pytest.mark.parametrize("lossless", [True, False])
def test_a_picture_is_reduced_and_its_bytes_are_a_function_of_it(lossless):
    grey = np.linspace(0, 255, 200 * 100).reshape(100, 200).astype(np.uint8)
    picture = web_picture(grey, "alt", 50, lossless=lossless)
    assert (picture.width, picture.height) == (50, 25)
    assert picture == web_picture(grey.copy(), "alt", 50, lossless=lossless)
    assert web_picture(grey, "", 4000).width == 200


def test_budgets_shrink_and_hold_the_promised_sizes():
    budgets = [budget_for(count) for count in (1, 3, 4, 100, 5000)]
    assert budgets[0] is budgets[1]
    for key in ("texture", "preview", "triangles"):
        values = [getattr(budget, key) for budget in budgets]
        assert values == sorted(values, reverse=True)
    assert budgets[-1].triangles == 0
    assert report_page.budget_for(1 << 30) is budgets[-1]
