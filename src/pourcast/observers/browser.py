"""Driving the real page with simulated observers, in a headless browser (or one to watch)."""

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette

from pourcast.errors import InputError, StoreError
from pourcast.experiment.design.links import link_key
from pourcast.experiment.server.app import create_app
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.server.process import lock_study
from pourcast.experiment.storage.storage import Storage
from pourcast.extras import optional_module
from pourcast.observers.observers import Observers
from pourcast.observers.rehearsal import Rehearsal
from pourcast.observers.responses import observers_table
from pourcast.progress import Report, no_report

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
    report: Report = no_report,
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
        Told how many have taken part.

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
        report("taking part", observer + 1, count)


def take_part_in_browser(
    study: Path, observers: Observers, *, visual: bool = False, report: Report = no_report
) -> str:
    """Let simulated observers take part in a study through its real page.

    Parameters
    ----------
    study
        The study folder. Its design says who sees what.
    observers
        The observers.
    visual
        In a window to watch, at a human pace.
    report
        Told of the progress.

    Returns
    -------
    str
        The database that has what they answered.

    Raises
    ------
    InputError
        If the study is not fit for an experiment, or there is no browser.
    StoreError
        If the study is being served, or an observer does not come to the end.
    """
    storage = Storage.of_study(study)
    with lock_study(study):
        experiment = LiveExperiment(study, storage, report)
        try:
            # Who sees what is the design's to say: here everybody has an answer to everything.
            table = observers_table(study, experiment.scenes, replace(observers, groups=()), report)
            app = create_app(experiment, rehearsal=Rehearsal(table, experiment.scenes))
            with served(app) as base, chromium(headless=not visual) as browser:
                drive_observers(
                    browser, base, link_key(storage.secret, "simulation"), observers.count,
                    visual=visual, report=report,
                )  # fmt: skip
        finally:
            experiment.close()
    return str(storage.url.database)
