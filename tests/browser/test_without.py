"""The report where something is missing, WebGL or scripts, or where a name is hostile."""

import pytest

from browser.conftest import visit
from browser.looks import OPEN, changed, open_asset, pixels

pytestmark = pytest.mark.slow


def test_without_webgl_it_has_stills_and_says_so(browser_without_webgl, report):
    with visit(browser_without_webgl, report, expected="WebGL") as page:
        section = open_asset(page, "bowl")
        assert section.locator("[data-view]").get_attribute("data-state") == "stills"
        assert "till picture" in section.locator("[data-view-note]").inner_text()
        assert not section.locator("canvas").is_visible()
        stage = section.locator(".stage")
        seen = []
        buttons = section.locator("button[data-mode]:visible").all()
        assert len(buttons) >= 2
        for button in buttons:
            button.click()
            assert section.locator("img[data-still]:visible").count() == 1
            seen.append(pixels(stage))
        assert all(changed(seen[0], other) > 0.02 for other in seen[1:])


def test_without_scripts_everything_is_on_one_page(browser, report):
    with visit(browser, report, java_script_enabled=False) as page:
        assert page.locator("#assets tbody tr:visible").count() == 4
        assert page.locator("section.asset:visible").count() == 4
        assert page.locator("input:visible, button:visible").count() == 0
        still = page.locator("section.asset img[data-still]:visible").first
        assert pixels(still).std() > 5
        texture = page.locator("figure[data-picture=texture] img:visible").first
        assert pixels(texture).std() > 5


def test_hostile_names_do_nothing(browser, hostile_report):
    with visit(browser, hostile_report) as page:
        page.locator(OPEN).wait_for()
        page.wait_for_timeout(300)
        assert page.evaluate("() => globalThis.harmed") is None
        assert "<img src=x onerror=harmed=1>" in page.locator("h2:visible").first.inner_text()
        assert "</title>" in page.title()
        assert "49" not in page.title()
        assert page.locator("img[src=x], body > svg").count() == 0
