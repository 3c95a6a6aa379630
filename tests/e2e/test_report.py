"""Reports in a real browser: nothing is fetched, nothing complains, everything answers.

Needs Chromium (Debian: `apt-get install chromium`), and is skipped without.
"""

import json
import shlex
import shutil
from contextlib import contextmanager

import pandas as pd
import pytest
from playwright.sync_api import sync_playwright

from pourcast import cli
from pourcast.report.page import Options, write_report
from tests.report.conftest import comparison, study
from tests.test_docs import LONG_LINES

__all__ = ["comparison", "study"]

CHROMIUM = shutil.which("chromium")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")


@contextmanager
def opened(path):
    """A page in a browser, with what it complained about and what it asked for."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        complaints, asked = [], []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(path.resolve().as_uri())
        page.wait_for_function("[...document.images].every((image) => image.complete)")
        yield page, complaints, asked
        browser.close()


def check(path, folder):
    """Open a report, use it, keep a screenshot."""
    with opened(path) as (page, complaints, asked):
        assert page.evaluate("[...document.images].every((image) => image.naturalWidth > 0)")
        page.wait_for_function(
            "[...document.querySelectorAll('video')].every((video) => video.readyState >= 2)"
        )
        models = page.locator("#explore select").nth(1)
        before = page.locator("#explore svg.plot").inner_html()
        models.select_option(index=1)
        assert page.locator("#explore svg.plot").inner_html() != before
        dots = page.locator("#explore svg.plot circle")
        dots.nth(2).dispatch_event("mouseenter")
        label = dots.nth(2).get_attribute("aria-label")
        assert page.locator("#thumbnail p").inner_text() == label
        assert page.locator("#thumbnail polygon").count() > 2
        wide = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
        assert wide <= 0, "the page scrolls sideways"
        page.screenshot(path=folder / "report.png", full_page=True)
        assert complaints == []
        assert [url for url in asked if not url.startswith("data:")] == [path.resolve().as_uri()]
        return page.title(), dots.count()


def test_a_report_works_offline_in_chromium(comparison, tmp_path):
    page = write_report(comparison, tmp_path, Options(films=1, studies=0))
    title, dots = check(page, tmp_path)
    assert title == "Simulated observers: study, Experiment 1 (basins)"
    assert dots == 10


@pytest.mark.slow
def test_the_reproductions_of_the_documentation(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for line in LONG_LINES:
        assert cli.run(shlex.split(line)[1:]) == 0, line
    first = (tmp_path / "out" / "report" / "report.html").read_bytes()
    for out, experiment in (("out", "Experiment 1 (basins)"), ("out2", "Experiment 2 (cup)")):
        title, dots = check(tmp_path / out / "report" / "report.html", tmp_path)
        assert title == f"Simulated observers: {out}, {experiment}"
        assert dots == 24
    assert "carried over unchanged" in (tmp_path / "out2" / "report" / "report.html").read_text()
    # A planted zeta is found again (24 scenes, 30 observers); strong dampings are much alike.
    capsys.readouterr()
    assert cli.run(["recover", "parameters", "out", "--observers", "30", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert min(row["within_one_step"] for row in rows if row["planted"] <= 10) >= 0.9
    assert min(row["within_one_step"] for row in rows) >= 0.8
    # Again: everything is there already, and comes out the same.
    assert cli.run(shlex.split(LONG_LINES[0])[1:]) == 0
    assert (tmp_path / "out" / "report" / "report.html").read_bytes() == first
    # People's responses take the observers' place.
    people = pd.read_csv("out/responses/simulated.csv").assign(simulated=False)
    people.to_csv("people.csv", index=False)
    quick = ["--responses", "people.csv", "--studies", "0", "--films", "0"]
    assert cli.run(["report", "out", *quick]) == 0
    title, _ = check(tmp_path / "out" / "report" / "report.html", tmp_path)
    assert title == "out, Experiment 1 (basins)"
