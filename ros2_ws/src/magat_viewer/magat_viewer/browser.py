"""The page in a headless Chromium of this machine: for tests, screenshots and the bench."""

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
#: It draws on the processor, which every machine has, and asks nobody for anything.
_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
#: How long the page may take to show something, seconds.
PATIENCE = 30.0


class BrowserError(MagatError, RuntimeError):
    """There is no browser, or the page does not do in it what it should; the message says what."""


def find_chromium() -> Path:
    """Where this machine's Chromium is.

    Raises:
        BrowserError: there is none.
    """
    for name in _NAMES:
        if found := shutil.which(name):
            return Path(found)
    raise BrowserError(f"there is no {', '.join(_NAMES)}: install one, on Debian by apt install chromium")


@contextmanager
def chromium() -> Iterator["Browser"]:
    """A browser without a window, as long as the ``with`` statement lasts.

    Raises:
        BrowserError: there is no Chromium.
    """
    from playwright.sync_api import sync_playwright  # needed by nobody who only watches

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=_ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


def until(page: "Page", expression: str, patience: float = PATIENCE) -> Any:
    """Wait until a JavaScript expression is true, and return its value.

    The page's own rules forbid what it evaluates to be given as text, so it is asked again and again from outside.

    Raises:
        BrowserError: it is not in time.
    """
    deadline = time.monotonic() + patience
    while not (value := page.evaluate(expression)):
        if time.monotonic() > deadline:
            raise BrowserError(f"after {patience:g} s it is not true that {expression}")
        time.sleep(0.02)
    return value


def screenshot(url: str, path: Path, width: int = 1440, height: int = 900) -> None:
    """Write what the page at ``url`` shows, once it shows an episode and its chosen robot, to a PNG file.

    Raises:
        BrowserError: there is no Chromium, or nothing is shown.
    """
    with chromium() as browser:
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(url)
        until(page, "Boolean(magat.player.frame && (magat.chosen() === null || magat.detail()))")
        page.wait_for_timeout(300)  # texts follow a tenth of a second after
        page.screenshot(path=path)
