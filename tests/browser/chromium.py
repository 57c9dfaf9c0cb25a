"""Chromium without a window, without a GPU and without a word to the network; as a program it says which one it finds.

WebGL is drawn by SwiftShader, on the processor.
"""

import shutil
import sys
from contextlib import contextmanager
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
)
QUIET = (
    "--disable-background-networking", "--disable-component-update", "--disable-quic", "--disable-sync",
    "--no-first-run", "--no-sandbox",
)  # fmt: skip
WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NO_WEBGL = ("--disable-3d-apis",)


def executable(playwright):
    """The path of a Chromium: the system's, or the one that Playwright has installed; None where there is none."""
    places = [shutil.which(name) for name in NAMES] + [*PLACES, playwright.chromium.executable_path]
    return next((place for place in places if place and Path(place).exists()), None)


@contextmanager
def launched(playwright, *, webgl=True):
    """A running Chromium. Raises FileNotFoundError where there is none."""
    path = executable(playwright)
    if path is None:
        raise FileNotFoundError("there is no Chromium or Chrome, which `sh scripts/setup-browser python` installs")
    browser = playwright.chromium.launch(executable_path=path, args=[*QUIET, *(WEBGL if webgl else NO_WEBGL)])
    try:
        yield browser
    finally:
        browser.close()


if __name__ == "__main__":
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        try:
            with launched(driver) as browser:
                print(executable(driver), browser.version)
        except FileNotFoundError as error:
            sys.exit(str(error))
