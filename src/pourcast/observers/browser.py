"""Driving the real page with simulated observers, in a headless browser (or one to watch)."""

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn
from starlette.applications import Starlette

from pourcast.errors import InputError, StoreError
from pourcast.extras import optional_module

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

_SWITCHES = (
    "--autoplay-policy=no-user-gesture-required",
    "--disable-background-networking",
    "--no-first-run",
)

_LONGEST = 3600.0
"""After so long an observer is given up [s]."""


@contextmanager
def served(app: Starlette) -> Iterator[str]:
    """Serve an application on a free port of this machine; yields its URL."""
    config = uvicorn.Config(app, port=0, log_level="error", access_log=False)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        while not server.started:
            if not thread.is_alive():
                raise StoreError("the server could not be started on this machine")
            thread.join(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        yield f"http://127.0.0.1:{port}"
    finally:
        server.should_exit = True
        thread.join()


@contextmanager
def chromium(*, headless: bool = True) -> Iterator[Any]:
    """A Chromium (or Chrome) of this machine, or Playwright's own; yields Playwright's browser.

    Raises
    ------
    InputError
        If there is none.
    """
    playwright = optional_module("playwright.sync_api", "browser")
    found = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    # As root, in a container, Chromium can't have its sandbox.
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    switches = [*_SWITCHES, *(["--no-sandbox"] if root else [])]
    with playwright.sync_playwright() as driver:
        try:
            browser = driver.chromium.launch(
                executable_path=found, headless=headless, args=switches
            )
        except playwright.Error as error:
            first = str(error).strip().splitlines()[0]
            raise InputError(
                f"no browser could be started ({first}); install Chromium, or run "
                "`playwright install chromium`"
            ) from None
        try:
            yield browser
        finally:
            browser.close()


def drive_observers(
    browser: Any,
    base: str,
    key: str,
    count: int,
    *,
    visual: bool = False,
    report: Callable[[int], None] | None = None,
) -> None:
    """Let simulated observers take part, one after another, from consent to code.

    Parameters
    ----------
    browser
        From `chromium`.
    base
        URL of the server.
    key
        Word of the link for simulations.
    count
        How many.
    visual
        At the observers' own pace; otherwise at full speed.
    report
        Told how many are done.

    Raises
    ------
    StoreError
        If one does not come to the end.
    """
    mode = "visual" if visual else "data-only"
    for observer in range(count):
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.goto(f"{base}/?simulation={key}&observer={observer}&mode={mode}")
        page.wait_for_selector("#page[data-state]", timeout=1000 * _LONGEST)
        state = page.get_attribute("#page", "data-state")
        page.close()
        if state != "complete":
            raise StoreError(f"observer {observer + 1}: ended as {state}")
        if report is not None:
            report(observer + 1)
