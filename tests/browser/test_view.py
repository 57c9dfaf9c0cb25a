"""The 3D view of a report turns, and shows what its buttons say."""

import numpy as np
import pytest

from browser.conftest import PHONE, visit
from browser.looks import OPEN, changed, live_view, open_asset, pixels

pytestmark = pytest.mark.slow

MODES = ["ao", "spheres", "checker", "error"]  # of the bowl, which has no colours of its own


def drag(page, canvas, across, up=0):
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + across, y - up, steps=4)
    page.mouse.up()


def test_the_mesh_is_drawn_in_the_middle_of_the_view(page):
    seen = pixels(live_view(page, "bowl"))
    ground = seen[2, 2]
    drawn = np.abs(seen - ground).max(axis=2) > 20
    rows, columns = np.nonzero(drawn)
    assert 0.1 < drawn.mean() < 0.9
    for places, size in ((rows, drawn.shape[0]), (columns, drawn.shape[1])):
        assert places.min() > 0
        assert places.max() < size - 1
        assert abs((places.min() + places.max()) / 2 - size / 2) < 0.2 * size


def test_the_mouse_turns_the_mesh(page):
    canvas = live_view(page, "car")
    before = pixels(canvas)
    drag(page, canvas, 120)
    turned = pixels(canvas)
    assert changed(before, turned) > 0.05
    drag(page, canvas, -120)
    assert changed(before, pixels(canvas)) < 0.01


def test_keys_turn_zoom_and_reset(page):
    canvas = live_view(page, "car")
    canvas.focus()
    page.keyboard.press("0")  # shows the focus too
    before = pixels(canvas)
    for key in ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-"):
        page.keyboard.press(key)
        page.keyboard.press(key)
        assert changed(before, pixels(canvas)) > 0.03, key
        page.keyboard.press("0")
        assert changed(before, pixels(canvas)) == 0, key


def test_a_finger_turns_the_mesh(browser, report):
    with visit(browser, report, **PHONE) as page:
        canvas = live_view(page, "car")
        before = pixels(canvas)
        box = canvas.bounding_box()
        x, y = box["x"] + box["width"] / 4, box["y"] + box["height"] / 2
        touch = page.context.new_cdp_session(page)
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
        for step in range(1, 9):
            points = [{"x": x + 15 * step, "y": y}]
            touch.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": points})
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        assert changed(before, pixels(canvas)) > 0.05


def test_every_button_shows_another_picture(page):
    canvas = live_view(page, "bowl")
    buttons = page.locator(f"{OPEN} button[data-mode]:visible")
    assert [button.get_attribute("data-mode") for button in buttons.all()] == MODES
    seen = {}
    for button in buttons.all():
        button.click()
        assert button.get_attribute("aria-pressed") == "true"
        assert page.locator(f"{OPEN} button[data-mode][aria-pressed=true]").count() == 1
        seen[button.get_attribute("data-mode")] = pixels(canvas)
    for mode, shown in seen.items():
        assert all(changed(shown, other) > 0.02 for name, other in seen.items() if name != mode), mode
    buttons.first.click()
    assert changed(seen["ao"], pixels(canvas)) == 0


def test_the_occlusion_darkens_the_inside_of_the_bowl(page):
    """The view looks down into it: its inside is darker with the texture than its clay alone would be."""
    canvas = live_view(page, "bowl")
    box = pixels(canvas)
    middle = box[box.shape[0] // 2 - 20 : box.shape[0] // 2 + 20, box.shape[1] // 2 - 20 : box.shape[1] // 2 + 20]
    assert middle.mean() < box.max() - 30


def test_material_shows_the_colours_of_the_file(page):
    canvas = live_view(page, "car")
    grey = pixels(canvas)
    page.locator(f"{OPEN} button[data-mode=material]").click()
    seen = pixels(canvas)
    assert np.ptp(grey, axis=2).max() < 20
    red = (seen[..., 0] > 1.5 * seen[..., 1]) & (seen[..., 0] > 1.5 * seen[..., 2]) & (seen[..., 0] > 60)
    assert red.mean() > 0.02  # its paint


def test_only_the_open_asset_has_a_view(page):
    live_view(page, "bowl")
    page.locator(f"{OPEN} a[data-go=overview]").click()
    page.locator("#overview").wait_for()
    assert page.locator("[data-view][data-state=live]").count() == 0
    live_view(page, "car")
    assert page.locator("[data-view][data-state=live]").count() == 1


def test_many_views_one_after_the_other(page):
    """Browsers take the graphics context from the oldest of 16 canvases."""
    for _ in range(10):
        for name in ("bowl", "car"):
            live_view(page, name)
            page.locator(f"{OPEN} a[data-go=overview]").click()
            page.locator("#overview").wait_for()
    assert pixels(live_view(page, "bowl")).std() > 5


def test_the_view_follows_the_size_of_the_window(page):
    canvas = live_view(page, "bowl")
    page.set_viewport_size({"width": 700, "height": 900})
    canvas.scroll_into_view_if_needed()
    assert pixels(canvas).std() > 5
    size = canvas.evaluate("(it) => [it.width / it.height, it.clientWidth / it.clientHeight]")
    assert abs(size[0] - size[1]) < 0.02


def test_a_failed_asset_has_no_view(page):
    section = open_asset(page, "broken")
    assert section.locator("canvas:visible").count() == 0
    assert section.locator(".message.bad").is_visible()
