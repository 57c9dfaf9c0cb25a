"""docs/make_pictures.py draws what the pictures of the documentation show."""

import importlib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
MAX_BYTES = 300_000


@pytest.fixture
def pictures(monkeypatch):
    """The script as a module, at a low quality."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    monkeypatch.syspath_prepend(ROOT / "examples")
    module = importlib.import_module("make_pictures")
    monkeypatch.setattr(module, "DIRECTIONS", 64)
    monkeypatch.setattr(module, "SAMPLES", 2000)
    return module


def pixels(picture):
    return np.asarray(picture.convert("RGB"), int)


@pytest.mark.slow
def test_borders_are_drawn_with_the_texels_that_are_read_and_padding(pictures):
    colors = {tuple(color) for color in pixels(pictures.borders()).reshape(-1, 3)}
    assert any(red > blue + 60 for red, _, blue in colors)  # orange: read by look-ups
    assert any(blue > red + 60 for red, _, blue in colors)  # blue: padding


@pytest.mark.slow
def test_two_sides_lighten_the_ring_that_is_inside_out(pictures):
    image = pixels(pictures.sides())
    upper, lower = (image[top : top + 290, 322:612] for top in (76, 466))
    assert (upper.max(axis=2) < 8).mean() > 0.2
    assert (lower.max(axis=2) < 8).mean() < 0.01


@pytest.mark.slow
def test_each_cell_of_the_spheres_shows_something_in_its_shadow(pictures):
    image = pixels(pictures.spheres())
    wide, high = pictures.PANEL
    assert image.shape == (40 + 2 * high, 3 * wide, 3)
    for row, column in np.ndindex(2, 3):
        cell = image[40 + row * high : 40 + (row + 1) * high, column * wide : (column + 1) * wide]
        assert (np.abs(cell - pictures.PAPER).sum(axis=2) > 60).mean() > 0.08


@pytest.mark.slow
def test_after_is_darker_than_before(pictures):
    image = pixels(pictures.before_after())
    wide, high = pictures.STUDIO
    before, after = image[40:, :wide], image[40:, -wide:]
    darker = (after < before - 20).any(axis=2)
    assert darker[: high // 2].mean() > 0.02  # under the roof
    assert darker[high // 2 :, 2 * wide // 3 :].mean() > 0.02  # the shadow
    assert (after > before + 8).mean() < 0.01


@pytest.mark.parametrize("name", ["before_after", "borders", "sides", "speed", "spheres"])
def test_pictures_are_small_files_that_pages_show(name):
    assert (ROOT / f"docs/pictures/{name}.png").stat().st_size < MAX_BYTES
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    assert any(f"pictures/{name}.png" in page.read_text("utf-8") for page in pages)
