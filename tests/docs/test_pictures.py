"""docs/make_pictures.py makes what the pictures of the documentation show, from results of this program."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from docs.pages import ROOT, pages

PICTURES = sorted((ROOT / "docs/pictures").glob("*.png"))
MAX_BYTES = 350_000


@pytest.fixture
def pictures(monkeypatch):
    """The script as a module, at a low quality; its sheets are lists of pictures in [0, 255] and their captions."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    monkeypatch.syspath_prepend(ROOT / "examples")
    module = importlib.import_module("make_pictures")
    monkeypatch.setattr(module, "DIRECTIONS", 64)
    monkeypatch.setattr(module, "SAMPLES", 2000)
    monkeypatch.setattr(module, "CELL", (160, 160))
    monkeypatch.setattr(
        module, "contact_sheet", lambda cells, _: [(np.int32(picture), text) for picture, text in cells]
    )
    return module


@pytest.mark.slow
def test_borders_are_drawn_with_the_texels_that_are_read_and_padding(pictures):
    cells = pictures.borders(Path())
    colors = {tuple(color) for picture, _ in cells for color in picture.reshape(-1, 3)}
    assert any(red > blue + 60 for red, _, blue in colors)  # orange: read by look-ups
    assert any(blue > red + 60 for red, _, blue in colors)  # blue: padding


@pytest.mark.slow
def test_two_sides_lighten_the_ring_that_is_inside_out(pictures):
    ring = [picture for picture, caption in pictures.sides(Path()) if "inwards" in caption.splitlines()[0]]
    default, _, two_sided, _ = (picture.mean() for picture in ring)  # the ring and the cup, twice
    assert two_sided > default + 10


@pytest.mark.slow
def test_after_is_darker_than_before(pictures):
    (before, _), (after, _) = pictures.before_after(Path())
    darker = (after < before - 20).any(axis=2)
    assert darker.mean() > 0.02
    assert (after > before + 20).mean() < 0.01


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: picture.stem)
def test_pictures_are_small_files_that_pages_show(picture):
    assert picture.stat().st_size < MAX_BYTES
    assert any(f"pictures/{picture.name}" in (ROOT / page).read_text("utf-8") for page in pages())
