"""Pages in Chromium that fail the test where the console has an error, or something beyond the file is asked for."""

from contextlib import contextmanager

import pytest

from browser.chromium import launched
from browser.runs import make_hostile_report, make_report

DESKTOP = {"width": 1200, "height": 900}
PHONE = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2, "is_mobile": True, "has_touch": True}


@pytest.fixture(scope="session")
def report(tmp_path_factory):
    """The page of three assets, compared with an earlier run."""
    return made_once(make_report, tmp_path_factory)


@pytest.fixture(scope="session")
def hostile_report(tmp_path_factory):
    """The page of a mesh with hostile names."""
    return made_once(make_hostile_report, tmp_path_factory)


def made_once(make, tmp_path_factory):
    return make(tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def driver():
    """Playwright, for one file: its event loop would be in the way of those of other tests."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: `make test-slow` does")
    with playwright.sync_playwright() as driver:
        yield driver


@contextmanager
def chromium(driver, **options):
    try:
        with launched(driver, **options) as browser:
            yield browser
    except FileNotFoundError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def browser(driver):
    """Chromium with WebGL."""
    with chromium(driver) as browser:
        yield browser


@pytest.fixture(scope="module")
def browser_without_webgl(driver):
    """Chromium without WebGL."""
    with chromium(driver, webgl=False) as browser:
        yield browser


@contextmanager
def visit(browser, path, *, expected="\0", **options):
    """A page that shows a file. Fails at its end if the console had an error, or anything else was asked for.

    expected   what errors of the console may speak of
    """
    wrong = []
    with browser.new_context(**{"viewport": DESKTOP, "reduced_motion": "reduce", **options}) as context:
        context.set_default_timeout(20_000)
        page = context.new_page()
        page.on("console", lambda message: wrong.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("dialog", lambda dialog: (wrong.append(dialog.message), dialog.dismiss()))
        page.on("request", lambda asked: None if allowed(asked.url, path) else wrong.append(f"request: {asked.url}"))
        page.goto(path.as_uri())
        yield page
        page.wait_for_timeout(50)  # for what is on its way
    assert [it for it in wrong if not (expected in it or harmless(it))] == []


def allowed(url, path):
    return url.partition("#")[0] == path.as_uri() or url.startswith(("data:", "blob:"))


def harmless(message):
    """Tell whether the console speaks of the speed of the driver, when a test looks at its pixels."""
    return "GL Driver Message" in message and "Performance" in message


@pytest.fixture
def page(browser, report):
    """The report, as a desktop shows it."""
    with visit(browser, report) as page:
        yield page
