"""The report page: table, slider, keyboard, light and dark, a phone's width, and WCAG by axe-core."""

import pytest

from browser.conftest import PHONE, visit
from browser.looks import FOCUSED, OPEN, REACHABLE, TO_THE_TOP, changed, names, open_asset, pixels

pytestmark = pytest.mark.slow

ASSETS = ["broken", "bowl", "car"]
EVERY_PAGE = [None, *ASSETS, "gone"]


def show(page, asset):
    """Open an asset; None: the table."""
    if asset is not None:
        open_asset(page, asset)


# The table.


def test_failures_come_first(page):
    rows = page.locator("#assets tbody tr")
    assert rows.first.get_attribute("data-status") == "failed"
    assert names(page)[0] == "broken"
    assert sorted(names(page)) == ["bowl", "broken", "car", "gone"]


def test_a_heading_sorts_and_sorts_backwards(page):
    heading = page.locator("#assets thead button[data-key=name]")
    heading.click()
    assert names(page) == ["bowl", "broken", "car", "gone"]
    assert heading.locator("..").get_attribute("aria-sort") == "ascending"
    heading.click()
    assert names(page) == ["gone", "car", "broken", "bowl"]
    assert heading.locator("..").get_attribute("aria-sort") == "descending"


def test_numbers_are_sorted_as_numbers_and_those_without_come_last(page):
    heading = page.locator("#assets thead button[data-key=triangles]")
    heading.click()
    assert names(page) == ["car", "bowl", "gone", "broken"]
    heading.click()
    assert names(page) == ["gone", "bowl", "car", "broken"]
    assert page.locator("#assets thead th[aria-sort]").count() == 1


def test_a_search_hides_what_lacks_its_words(page):
    page.locator("#search").fill("CAR")
    assert names(page) == ["car"]
    assert page.locator("#shown").inner_text().startswith("1 of 4")
    page.locator("#search").fill("no such thing")
    assert names(page) == []
    assert page.locator("#nothing").is_visible()
    page.locator("#search").fill("")
    assert len(names(page)) == 4


def test_a_button_shows_the_failures_alone(page):
    button = page.locator("button[data-filter=failed]")
    button.click()
    assert names(page) == ["broken"]
    assert button.get_attribute("aria-pressed") == "true"
    page.locator("button[data-filter=all]").click()
    assert len(names(page)) == 4


def test_a_row_opens_its_asset_and_back_returns(page):
    open_asset(page, "bowl")
    assert not page.locator("#overview").is_visible()
    assert page.locator("section.asset:visible").count() == 1
    page.go_back()
    page.locator("#overview").wait_for()
    assert page.locator("section.asset:visible").count() == 0


def test_next_and_previous_go_through_all_assets(page):
    first = page.locator("#assets tbody tr").first.get_attribute("data-asset")
    page.goto(f"{page.url.partition('#')[0]}#{first}")
    seen = [page.locator(f"{OPEN} h2").inner_text()]
    while page.locator(f"{OPEN} a[data-go=next]").count():
        page.locator(f"{OPEN} a[data-go=next]").click()
        page.wait_for_function(
            "(last) => document.querySelector('section.asset[data-open] h2').innerText !== last", arg=seen[-1]
        )
        seen.append(page.locator(f"{OPEN} h2").inner_text())
    assert sorted(seen) == ["bowl", "broken", "car", "gone"]


# Before and after.


def test_the_mouse_moves_the_slider(page):
    slider = open_asset(page, "bowl").locator("[data-slider]").first
    slider.scroll_into_view_if_needed()
    box, seen = slider.bounding_box(), []
    for share in (0.1, 0.9):
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2, steps=5)
        page.mouse.up()
        seen.append(pixels(slider))
        value = float(slider.locator("input").input_value())
        assert abs(value - 100 * share) < 12
    assert changed(*seen) > 0.02


def test_keys_move_the_slider_to_either_picture(page):
    slider = open_asset(page, "bowl").locator("[data-slider]").first
    slider.locator("input").focus()
    page.keyboard.press("Home")
    after = pixels(slider)
    page.keyboard.press("End")
    before = pixels(slider)
    assert changed(after, before) > 0.05
    page.keyboard.press("ArrowLeft")
    assert slider.locator("input").input_value() == "99"


# The keyboard.


@pytest.mark.parametrize("asset", EVERY_PAGE)
def test_the_tab_key_reaches_every_control_and_leaves_again(page, asset):
    show(page, asset)
    wanted = set(page.evaluate(REACHABLE))
    assert len(wanted) >= (12 if asset is None else 3)
    page.evaluate(TO_THE_TOP)
    reached = []
    for _ in range(len(wanted) + 5):
        page.keyboard.press("Tab")
        at = page.evaluate(FOCUSED)
        if at is None or at in reached:
            break
        reached.append(at)
    assert wanted == set(reached)


@pytest.mark.parametrize("asset", [None, "bowl"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_focus_is_seen(browser, report, asset, scheme):
    with visit(browser, report, color_scheme=scheme) as page:
        show(page, asset)
        page.evaluate(TO_THE_TOP)
        for _ in page.evaluate(REACHABLE):
            page.keyboard.press("Tab")
            around = page.evaluate(
                """() => { const it = document.activeElement, box = it.getBoundingClientRect();
                it.scrollIntoView({ block: "center" });
                const { x, y, width, height } = it.getBoundingClientRect();
                return { x: Math.max(x - 8, 0), y: Math.max(y - 8, 0), width: width + 16, height: height + 16 }; }"""
            )
            focused = page.screenshot(clip=around)
            page.evaluate("() => { globalThis.last = document.activeElement; last.blur(); }")
            what = page.evaluate("() => last.outerHTML.slice(0, 120)")
            assert page.screenshot(clip=around) != focused, what
            page.evaluate("() => last.focus()")


def test_the_keyboard_alone_sorts_opens_and_changes_the_view(page):
    page.locator("#assets thead button[data-key=name]").focus()
    page.keyboard.press("Enter")
    assert names(page)[0] == "bowl"
    page.locator("#assets tbody a").first.focus()
    page.keyboard.press("Enter")
    page.locator(OPEN).wait_for()
    assert page.evaluate("() => document.activeElement.closest('section')?.hasAttribute('data-open')")
    page.locator(f"{OPEN} button[data-mode=checker]").focus()
    page.keyboard.press("Space")
    assert page.locator(f"{OPEN} button[data-mode=checker]").get_attribute("aria-pressed") == "true"


# How it looks.


def lightness(page):
    return float(pixels(page.locator("body"))[4:40, 4:20].mean())


def test_it_is_light_or_dark_as_the_system_is(browser, report):
    for scheme, expected in (("light", True), ("dark", False)):
        with visit(browser, report, color_scheme=scheme) as page:
            assert (lightness(page) > 128) is expected


def test_the_reader_may_turn_light_and_dark(page):
    assert lightness(page) > 128
    page.locator("#theme").click()
    assert lightness(page) < 128
    page.reload()
    assert lightness(page) < 128
    page.locator("#theme").click()
    assert lightness(page) > 128


@pytest.mark.parametrize("asset", EVERY_PAGE)
def test_a_phone_shows_it_without_scrolling_sideways(browser, report, asset):
    with visit(browser, report, **PHONE) as page:
        show(page, asset)
        page.evaluate("() => document.querySelectorAll('details').forEach((it) => it.open = true)")
        width, beyond = page.evaluate(
            """() => [document.documentElement.scrollWidth, [...document.querySelectorAll("main *")]
            .filter((it) => it.checkVisibility() && !it.closest(".scroll, pre"))
            .filter((it) => it.getBoundingClientRect().right > 391)
            .map((it) => it.outerHTML.slice(0, 80))]"""
        )
        assert width <= 390
        assert beyond == []


@pytest.mark.parametrize("asset", EVERY_PAGE)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("device", ["desktop", "phone"])
def test_axe_finds_nothing_serious(browser, report, device, scheme, asset):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with visit(browser, report, color_scheme=scheme, **(PHONE if device == "phone" else {})) as page:
        show(page, asset)
        page.evaluate("() => document.querySelectorAll('details').forEach((it) => it.open = true)")
        found = axe.Axe().run(page).response["violations"]
        told = [
            (it["id"], node["html"][:120], node["failureSummary"])
            for it in found
            for node in it["nodes"]
            if it["impact"] in ("serious", "critical")
        ]
        assert told == []


def test_every_picture_is_there_and_says_what_it_shows(page):
    for asset in EVERY_PAGE:
        show(page, asset)
        pictures = page.locator("img:visible")
        for picture in pictures.all():
            picture.scroll_into_view_if_needed()
            assert picture.evaluate("(it) => it.decode().then(() => it.naturalWidth > 0)")
            assert pixels(picture).std() > 1
            if not picture.evaluate("(it) => Boolean(it.closest('td.thumb'))"):  # the name stands beside it
                assert len(picture.get_attribute("alt")) > 5
        if asset is not None:
            page.locator(f"{OPEN} a[data-go=overview]").click()
            page.locator("#overview").wait_for()
