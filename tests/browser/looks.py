"""What tests do with a page: open an asset, look at pixels, walk with the Tab key."""

from io import BytesIO

import numpy as np
from PIL import Image

OPEN = "section.asset[data-open]"

# Every element that a keyboard should reach now.
REACHABLE = """() => [...document.querySelectorAll("a[href], button, input, select, textarea, summary, [tabindex]")]
  .filter((it) => it.tabIndex >= 0 && !it.disabled && it.checkVisibility({ visibilityProperty: true }))
  .map((it, number) => it.dataset.test = it.dataset.test ?? String(number))"""

# From where the next Tab goes to the first of them.
TO_THE_TOP = "() => { const { body } = document; body.tabIndex = -1; body.focus(); body.removeAttribute('tabindex'); }"

FOCUSED = "() => document.activeElement?.dataset.test ?? null"


def open_asset(page, name):
    """Open an asset by its link in the table, and wait for its 3D view where it has one."""
    page.locator("#assets tbody a", has_text=name).first.click()
    section = page.locator(OPEN)
    section.locator("h2", has_text=name).wait_for()
    view = section.locator("[data-view]")
    if view.count():
        page.locator(f"{OPEN} [data-view]:not([data-state=closed]):not([data-state=loading])").wait_for()
    return section


def live_view(page, name):
    """Open an asset, and return the canvas of its 3D view."""
    section = open_asset(page, name)
    assert section.locator("[data-view]").get_attribute("data-state") == "live"
    canvas = section.locator("[data-view] canvas")
    canvas.scroll_into_view_if_needed()
    return canvas


def pixels(locator):
    """What an element shows, (h, w, 3) int."""
    if locator.page.evaluate("() => document.documentElement.classList.contains('js')"):  # else no frame is ever told
        locator.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return np.asarray(Image.open(BytesIO(locator.screenshot())).convert("RGB"), int)


def changed(before, after):
    """The share of pixels that differ visibly."""
    assert before.shape == after.shape
    return float((np.abs(before - after).max(axis=2) > 8).mean())


def names(page):
    """The names in the table, in the order of the rows that are shown."""
    return page.locator("#assets tbody tr:visible th a").all_inner_texts()
