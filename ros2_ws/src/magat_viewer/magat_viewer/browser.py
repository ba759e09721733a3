# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page in a headless Chromium, for tests, screenshots and the bench."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from magat_node.errors import MagatError

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

_NAMES = ("chromium", "chromium-browser", "google-chrome")
#: Chromium renders on the CPU, which every machine has, and makes no requests of its own.
_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
#: How long the page may take until it shows something, seconds.
PATIENCE = 30.0


class BrowserError(MagatError, RuntimeError):
    """There is no browser, or the page does not work in it."""


def find_chromium() -> Path:
    """The path of Chromium.

    Raises:
        BrowserError: it is not installed.
    """
    for name in _NAMES:
        if found := shutil.which(name):
            return Path(found)
    raise BrowserError(f"none of {', '.join(_NAMES)} is installed: install one, on Debian with `apt install chromium`")


@contextmanager
def chromium() -> Iterator["Browser"]:
    """A headless browser, for use in a ``with`` statement.

    Raises:
        BrowserError: Chromium is not installed.
    """
    from playwright.sync_api import sync_playwright  # not needed to view a page

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=_ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


def until(page: "Page", expression: str, patience: float = PATIENCE) -> Any:
    """Wait until a JavaScript expression is true, and return its value.

    It polls, because the page's security policy forbids expressions that are evaluated inside the page.

    Raises:
        BrowserError: the expression is still false after ``patience`` seconds.
    """
    deadline = time.monotonic() + patience
    while not (value := page.evaluate(expression)):
        if time.monotonic() > deadline:
            raise BrowserError(f"the page did not show what was expected within {patience:g} s: {expression} is false")
        time.sleep(0.02)
    return value


def screenshot(url: str, path: Path, width: int = 1440, height: int = 900) -> None:
    """Write the page at ``url`` to a PNG file, once it shows an episode and the chosen robot.

    Raises:
        BrowserError: Chromium is not installed, or the page shows no episode.
    """
    with chromium() as browser:
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(url)
        until(page, "Boolean(magat.player.frame && (magat.chosen() === null || magat.detail()))")
        page.wait_for_timeout(300)  # texts are updated every 0.1 s
        page.screenshot(path=path)
