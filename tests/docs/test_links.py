"""Relative links of the pages outside the site lead somewhere; Sphinx checks those of the site itself."""

import re

import pytest

from docs.pages import ROOT, pages

PAGES = sorted(path.name for path in ROOT.glob("*.md"))
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")


def anchors(text):
    """The anchors that GitHub gives the headings of a page."""
    titles = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES)
def test_relative_links_lead_to_files_and_headings(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for match in LINK.findall(re.sub(r"^```.*?^```|`+[^`\n]+`+", "", text, flags=re.M | re.S)):
        target, _, anchor = "".join(match).partition("#")
        if re.match(r"\w+:", target):
            continue
        file = ROOT / target if target else ROOT / page
        assert file.exists(), f"{page}: there is no {target}"
        if anchor:
            assert anchor in anchors(file.read_text(encoding="utf-8")), f"{page}: {target} has no heading #{anchor}"


@pytest.mark.parametrize("page", pages())
def test_links_to_the_repository_lead_to_files(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for path in re.findall(r"https://github\.com/aoprecalc/aoprecalc/(?:blob|tree)/main/([\w./-]+\w)", text):
        assert (ROOT / path).exists(), f"{page}: there is no {path}"
