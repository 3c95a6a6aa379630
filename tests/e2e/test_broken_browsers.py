"""Browsers that lack something, or deny it: all answers arrive, and who can't go on is told why.

Needs Chromium (Debian: `apt-get install chromium`), and is skipped without. The browsers differ by
what scripts take away before the page is loaded.
"""

import json
import re
import shutil

import pytest

from pourcast.experiment.design.settings import read_design, texts_of
from pourcast.observers.browser import served
from tests.e2e import broken_browsers as without
from tests.e2e.participant import Participant, lab_link, open_experiment, saved
from tests.experiment.make import EXP1, small_study

pytestmark = pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no Chromium")

SHORT = EXP1 + "blocks = 1\n"


def fail(route, fault):
    """Let a request fail: nobody is reached, or the answer is another one."""
    if fault == "abort":
        route.abort()
    else:
        route.fulfill(**fault)


@pytest.fixture
def experiment(tmp_path):
    """A small study that is served: the experiment and its link."""
    opened, app = open_experiment(small_study(tmp_path, scenes=2, design=SHORT))
    with served(app) as base:
        yield opened, lab_link(base, opened)
    opened.close()


def takes_part(opened, link, browser, script):
    """A whole session, with a reload in its middle."""
    someone = Participant(browser, link, script=script)
    someone.begin()
    someone.go_on(stop_at=1)
    someone.page.reload()
    someone.see("Welcome back")
    someone.press("Go on")
    someone.go_on()
    assert someone.page.get_attribute("#page", "data-state") == "complete"
    someone.see("Thank you!")
    (session,) = opened.storage.sessions()
    assert session.state == "complete"
    assert saved(opened) == pytest.approx(someone.answers, abs=0.004)
    assert len(someone.answers) == 3
    assert opened.storage.conflicts() == []
    someone.check()
    someone.close()


def oldest(browser):
    return without.without_what_is_newer(browser, without.oldest(browser))


@pytest.mark.parametrize(
    "lacking",
    [
        pytest.param(without.NOTHING_NEW, id="nothing of the last ten years"),
        pytest.param(without.DATABASE_NEVER_OPENS, id="a database that never opens"),
        pytest.param(without.COOKIES_BLOCKED, id="all storage denied", marks=pytest.mark.slow),
        pytest.param(without.DATABASE_NEVER_WRITES, id="no writes end", marks=pytest.mark.slow),
        pytest.param(without.NO_LIMITS, id="no AbortSignal.timeout", marks=pytest.mark.slow),
        pytest.param(without.NO_STORAGE, id="localStorage denied", marks=pytest.mark.slow),
        pytest.param(without.FULL_STORAGE, id="localStorage full", marks=pytest.mark.slow),
    ],
)
def test_a_whole_session_without(experiment, browser, lacking):
    takes_part(*experiment, browser, lacking)


@pytest.mark.slow
@pytest.mark.skipif(not without.COMPATIBILITY.is_file(), reason="needs npm --prefix tests ci")
@pytest.mark.parametrize("kind", ["chrome", "firefox", "safari", "safari_ios"])
def test_a_whole_session_in_what_the_oldest_browsers_have(experiment, browser, kind):
    takes_part(*experiment, browser, oldest(kind))


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ({"status": 503}, "The server has a problem (status 503); still trying."),
        ("abort", "The server can't be reached; still trying."),
        ({"status": 200, "body": "<h1>Log in</h1>"}, "The server has a problem (the answer is"),
    ],
)
def test_what_passes_is_waited_for_and_named(experiment, browser, fault, sentence):
    _, link = experiment
    someone = Participant(browser, "about:blank")
    someone.link = link
    failing = [True]

    def answer(route):
        fail(route, fault) if failing else route.continue_()

    someone.page.route("**/api/sessions", answer)
    someone.page.goto(link)
    someone.page.get_by_text(sentence).wait_for()
    failing.clear()
    someone.see("Welcome")
    someone.close()


def test_a_server_that_never_answers_is_told_of(experiment, browser):
    _, link = experiment
    someone = Participant(browser, "about:blank")
    page = someone.page
    page.clock.install()
    page.route("**/api/sessions", lambda route: None)
    page.goto(link)
    page.clock.run_for(1000)
    page.get_by_text("Reaching the server").wait_for()
    page.clock.run_for(25_000)
    page.get_by_text("The server does not answer; still trying.").wait_for()
    page.unroute("**/api/sessions")
    page.clock.run_for(25_000)
    someone.see("Welcome")
    someone.close()


@pytest.mark.parametrize(
    ("script", "sentence"),
    [
        ("delete window.AbortController;", "Something went wrong in this page: ReferenceError: Abort"),
        ("delete Response.prototype.json;", "json is not a function. Please reload"),
        ("delete Element.prototype.replaceChildren;", "This browser is too old for the study."),
        ("Object.fromEntries = () => { throw new Error('odd'); };", "page: Error: odd. Please rel"),
    ],
)  # fmt: skip
def test_what_does_not_pass_is_told_at_once(experiment, browser, script, sentence):
    _, link = experiment
    someone = Participant(browser, link, script=script)
    someone.page.get_by_text(sentence).wait_for()
    someone.close()


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("abort", "A part of this page could not be loaded."),
        ({"status": 404}, "A part of this page could not be loaded."),
        ({"body": "let = (;", "content_type": "text/javascript"}, "Something went wrong in this page"),
    ],
)  # fmt: skip
def test_a_page_without_its_script_is_not_empty(experiment, browser, fault, sentence):
    _, link = experiment
    someone = Participant(browser, "about:blank")

    someone.page.route("**/assets/app-*.js", lambda route: fail(route, fault))
    someone.page.goto(link)
    someone.page.get_by_text(sentence).wait_for()
    someone.close()


def test_without_javascript_the_page_says_so_where_it_is_seen(experiment, browser):
    _, link = experiment
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(link)
    assert page.inner_text("noscript p").startswith("This study needs JavaScript.")
    box = page.locator("noscript p").bounding_box()
    assert box["y"] + box["height"] < page.viewport_size["height"] / 2
    context.close()


BREAKS_WHEN_IT_KEEPS = """() => {
  const has = Map.prototype.has;
  Map.prototype.has = function (key) {
    if (/^\\S+ \\d+$/.test(key)) throw new Error("odd");
    return has.call(this, key);
  };
}"""
"""Nothing in the page can be broken from outside but what it is made with."""


def test_a_defect_in_the_middle_offers_what_was_answered(experiment, browser):
    _, link = experiment
    someone = Participant(browser, link, accept_downloads=True)
    someone.begin()
    someone.go_on(stop_at=1)
    someone.page.locator("button:enabled").wait_for()
    someone.page.evaluate(BREAKS_WHEN_IT_KEEPS)
    someone.page.locator("button:enabled").click()
    someone.page.wait_for_selector("#page[data-state=broken]")
    said = someone.page.inner_text("#page")
    assert "Something went wrong in this page, and it can't go on: Error: odd." in said
    assert "Your answers are safe in this browser." in said
    with someone.page.expect_download() as download:
        someone.page.get_by_role("link", name="Download my answers").click()
    content = json.loads(download.value.path().read_text())
    answers = [line["body"]["response"] for line in content if line.get("kind") == "judgment"]
    assert answers == pytest.approx(someone.answers, abs=0.004)
    assert {line["trial_type"] for line in content} == {"pourcast"}
    someone.close()


@pytest.mark.slow
def test_two_tabs_are_recognised_without_channels(experiment, browser):
    _, link = experiment
    someone = Participant(browser, link, script="delete window.BroadcastChannel;")
    someone.begin()
    someone.judge(0.5)
    first, someone.page = someone.page, someone.open()
    someone.see("The study is open in another window")
    someone.press("Go on here")
    first.get_by_text("You went on in another window").wait_for()
    someone.see("Welcome back")
    someone.close()


@pytest.mark.slow
def test_a_picture_that_is_nowhere_is_not_called_a_slow_connection(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, "about:blank")
    someone.page.route("**/media/*.png", lambda route: route.fulfill(status=404))
    someone.page.goto(link)
    someone.begin()
    someone.page.get_by_text("A picture of this study is not where it should be").wait_for()
    someone.page.unroute("**/media/*.png")
    someone.go_on()
    assert saved(opened) == pytest.approx(someone.answers, abs=0.004)
    someone.close()


@pytest.mark.slow
def test_a_server_that_refuses_answers_is_not_called_unreachable(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    refusal = {"status": 413, "body": "at most 65536 bytes"}
    someone.page.route("**/api/session/records/*", lambda route: route.fulfill(**refusal))
    someone.begin()
    someone.go_on()
    assert someone.page.get_attribute("#page", "data-state") == "refused"
    said = someone.page.inner_text("#page")
    assert "Your answers were not taken: status 413." in said
    someone.page.unroute("**/api/session/records/*")
    # Loaded again, after somebody has seen to it, all of it is sent, and nothing asked again.
    someone.page.reload()
    someone.see("Thank you!")
    someone.page.wait_for_selector("#page[data-state=complete]")
    assert saved(opened) == pytest.approx(someone.answers, abs=0.004)
    someone.close()


@pytest.mark.slow
def test_answers_that_are_in_the_page_alone_are_said_to_be(experiment, browser):
    _, link = experiment
    someone = Participant(browser, link, script=without.COOKIES_BLOCKED)
    someone.begin()
    someone.context.set_offline(True)
    someone.page.wait_for_timeout(500)
    someone.go_on(stop_at=3)
    someone.page.fill("textarea", "All clear.")
    someone.press("Finish")
    someone.page.wait_for_selector("#page[data-state=offline]", timeout=60_000)
    said = someone.page.inner_text("#page")
    assert "The server can't be reached. This page goes on trying." in said
    assert "Your answers are in this page alone" in said
    someone.context.set_offline(False)
    someone.page.wait_for_selector("#page[data-state=complete]", timeout=60_000)
    someone.close()


def test_the_sentence_names_the_oldest_browsers_that_are_built_for(tmp_path):
    study = small_study(tmp_path)
    sentence = texts_of(study, read_design(study))["page"]["old"]
    named = dict(re.findall(r"(Chrome|Firefox|Safari)[^,]*? from ([0-9.]*[0-9])", sentence))
    assert named == {name: without.oldest(name.lower()) for name in ("Chrome", "Firefox", "Safari")}
