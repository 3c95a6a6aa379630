"""The engines that participants have, Chrome's, Firefox's and Safari's: whole sessions in each.

Each browser is skipped where it is not there (see `real_browsers.py`).
"""

import json
import time

import pytest

from pourcast.experiment.data.tables import participants_table, trials_table
from pourcast.observers.browser import served
from tests.e2e.participant import lab_link, open_experiment
from tests.e2e.real_browsers import BROWSERS, HEIGHT, WIDTH, firefox_tab
from tests.experiment.make import EXP1, small_study

DESIGN = EXP1.replace("fullscreen = false\n", "") + "blocks = 1\n"


def needs(name):
    """A browser's parameter, skipped where the browser is not there."""
    return pytest.param(name, marks=pytest.mark.skipif(not BROWSERS[name][1], reason=f"no {name}"))


in_each_browser = pytest.mark.parametrize("browser", [needs(name) for name in BROWSERS])


@pytest.fixture
def experiment(tmp_path):
    """A study of two trials that is served: the experiment and its link."""
    opened, app = open_experiment(small_study(tmp_path / "study", scenes=2, design=DESIGN))
    with served(app) as base:
        yield opened, lab_link(base, opened)
    opened.close()


class Visitor:
    """A participant at a tab of any browser."""

    def __init__(self, tab):
        self.tab = tab
        self.answers = []

    def wait(self, function, *arguments):
        """What a function of the page returns, as soon as it is something."""
        until = time.monotonic() + 30.0
        while time.monotonic() < until:
            found = self.tab.run(function, *arguments)
            if found:
                return found
            time.sleep(0.02)
        text = self.tab.run("() => document.body.innerText")
        raise AssertionError(f"in vain: {function} {arguments}; there is: {text}")

    def see(self, title):
        self.wait("title => document.querySelector('h1')?.innerText.startsWith(title)", title)

    def read_that(self, text):
        self.wait("text => document.querySelector('#page').innerText.includes(text)", text)

    def focus(self):
        """Text of what has the focus."""
        return self.tab.run("() => document.activeElement.innerText")

    def where(self, css, text=""):
        """Where an element is, when it is to be seen and not disabled: left, top, width, height."""
        return self.wait(
            """(css, text) => {
              for (const one of document.querySelectorAll(css)) {
                const box = one.getBoundingClientRect();
                if (!one.innerText.startsWith(text) || !box.width || one.disabled) continue;
                one.scrollIntoView({ block: "nearest" });
                const { left, top, width, height } = one.getBoundingClientRect();
                return [left, top, width, height];
              }
            }""",
            css, text,
        )  # fmt: skip

    def press(self, text, css="button, a.jspsych-btn"):
        left, top, width, height = self.where(css, text)
        self.tab.point(left + width / 2, top + height / 2, press=True)

    def enter(self, title):
        """Press ENTER on a page, which a button or a notice hears."""
        self.see(title)
        self.wait("() => document.activeElement.matches('button, .notice')")
        self.tab.key("Enter")

    def begin(self):
        """From consent to the first trial."""
        self.enter("Welcome")
        self.enter("Full screen")
        self.read()
        self.quiz([0, 0, 1])
        self.read_that("tries left: 2")
        self.read()
        self.quiz([1, 0, 1])

    def read(self):
        for words in ("Each picture shows", "", "Press ENTER to hand in"):
            self.read_that(words)
            before = self.tab.run("() => document.querySelector('#page').innerText")
            self.enter("What you will do")
            self.wait("before => document.querySelector('#page').innerText !== before", before)

    def quiz(self, choices):
        self.see("Is it all clear?")
        for question, choice in enumerate(choices):
            self.press("", f"fieldset:nth-of-type({question + 1}) label:nth-of-type({choice + 1})")
        self.press("Check my answers")
        self.wait("() => !document.querySelector('fieldset')")

    def trial(self):
        self.wait("() => document.activeElement.matches('.slider')")

    def judge(self, share, *, by):
        """Answer a trial by the mouse, the mouse alone, or the keyboard."""
        self.trial()
        before = self.tab.run("() => document.querySelector('.progress').innerText")
        time.sleep(0.25)  # a key that is held from before is not heard
        if by == "keyboard":
            for _ in range(round(abs(share - 0.5) * 10)):
                self.tab.key("PageUp")
        else:
            left, top, width, height = self.where(".slider")
            self.tab.point(left + share * width, top + height / 2)
        self.answers.append(share)
        if by == "mouse alone":
            self.press("Hand in")
        else:
            self.tab.key("Enter")
        self.wait(
            "before => document.querySelector('.slider')"
            " ? document.querySelector('.progress').innerText !== before"
            " : document.querySelector('#page').innerText.trim()",
            before,
        )

    def film(self, share=0.3):
        """Practice, with its film."""
        self.judge(share, by="mouse")
        self.see("This is what happens")
        self.wait("() => document.activeElement.matches('.onward:enabled')")
        self.tab.key("Enter")
        self.enter("The practice is over")

    def end(self):
        self.see("Almost done")
        self.press("", "textarea")
        self.tab.key("ArrowLeft")
        self.press("Finish")
        self.wait("() => document.querySelector('#page[data-state=complete]')?.dataset.state")
        self.see("Thank you!")

    def check(self, experiment):
        """All answers are in the database, and nothing else."""
        found = trials_table(experiment.storage)
        assert list(found["response"]) == pytest.approx(self.answers, abs=0.006)
        (session,) = experiment.storage.sessions()
        assert session.state == "complete"
        assert experiment.storage.saved_steps(session.number) == list(range(len(session.steps)))
        assert experiment.storage.conflicts() == []
        return found


def bodies(experiment, kind):
    return [json.loads(r.body) for r in experiment.storage.records() if r.kind == kind]


@in_each_browser
def test_a_session_from_consent_to_thanks(browser, experiment, tmp_path):
    opened, link = experiment
    with BROWSERS[browser][0](tmp_path) as tab:
        someone = Visitor(tab)
        tab.go(link)
        someone.begin()
        assert tab.run("() => Boolean(document.fullscreenElement)")
        someone.film()
        someone.judge(0.7, by="keyboard")
        someone.judge(0.25, by="mouse alone")
        someone.end()
        someone.wait("() => !document.fullscreenElement")
    found = someone.check(opened)
    assert list(found["input"]) == ["mouse", "keyboard", "mouse"]
    assert set(found["window_width"]) == {WIDTH}
    assert set(found["window_height"]) == {HEIGHT}
    assert set(found["picture_height"]) == {506.0}
    assert set(found["pixel_ratio"]) == {1.0}
    assert [one["played"] for one in bodies(opened, "film")] == [True]
    assert bodies(opened, "instructions")[0]["attempts"] == [[0, 0, 1], [1, 0, 1]]
    assert bodies(opened, "check")[0]["tries"] == 1
    (person,) = participants_table(opened.storage).to_dict("records")
    name = {"chromium": "chrome", "firefox": "firefox", "webkit": "safari"}[browser]
    assert person["browser"].startswith(name)


@pytest.mark.slow
@in_each_browser
def test_a_reload_in_the_middle_goes_on_where_it_was(browser, experiment, tmp_path):
    opened, link = experiment
    with BROWSERS[browser][0](tmp_path) as tab:
        someone = Visitor(tab)
        tab.go(link)
        someone.begin()
        someone.film()
        someone.judge(0.7, by="keyboard")
        tab.reload()
        someone.enter("Welcome back")
        # The browser has left full screen by the reload, and lets only a person go back to it.
        someone.enter("Full screen")
        someone.judge(0.2, by="mouse")
        someone.end()
    someone.check(opened)


@pytest.mark.slow
@in_each_browser
def test_a_second_tab_takes_over(browser, experiment, tmp_path):
    opened, link = experiment
    with BROWSERS[browser][0](tmp_path) as first:
        someone = Visitor(first)
        first.go(link)
        someone.begin()
        someone.film()
        first.run("() => document.exitFullscreen()")  # as who opens a second tab does
        someone.tab = first.beside(link)
        someone.see("The study is open in another window")
        someone.press("Go on here")
        someone.enter("Welcome back")
        someone.enter("Full screen")
        Visitor(first).read_that("You went on in another window")
        someone.judge(0.6, by="mouse")
        someone.judge(0.4, by="mouse")
        someone.end()
    someone.check(opened)


@pytest.mark.slow
@in_each_browser
def test_a_key_that_is_held_down_does_one_thing(browser, experiment, tmp_path):
    _, link = experiment
    with BROWSERS[browser][0](tmp_path) as tab:
        someone = Visitor(tab)
        tab.go(link)
        someone.see("Welcome")
        tab.key("Enter", held=20)
        someone.see("Full screen")
        tab.key("Enter", held=20)
        someone.see("What you will do")
        someone.read_that("Each picture shows")


@pytest.mark.slow
@in_each_browser
def test_a_click_on_the_page_takes_no_key_away(browser, experiment, tmp_path):
    """Safari gives buttons no focus when they are clicked, and others do."""
    opened, link = experiment
    with BROWSERS[browser][0](tmp_path) as tab:
        someone = Visitor(tab)
        tab.go(link)
        someone.begin()
        someone.trial()
        someone.press("How much", "h1")
        tab.key("PageUp")
        time.sleep(0.25)
        tab.key("Enter")
        someone.see("This is what happens")
    (found,) = trials_table(opened.storage)["response"]
    assert found == 0.6


@pytest.mark.slow
@pytest.mark.skipif(not BROWSERS["firefox"][1], reason="no firefox")
@pytest.mark.parametrize(
    "preferences",
    [
        # Nothing plays by itself, muted or not; a press allows one film.
        {"media.autoplay.default": 5, "media.autoplay.blocking_policy": 2},
        {"browser.privatebrowsing.autostart": True},
        # Cookies are blocked, and with them all that a page could keep.
        {"network.cookie.cookieBehavior": 2},
        {"ui.prefersReducedMotion": 1},
    ],
    ids=["no autoplay", "private window", "nothing may be kept", "reduced motion"],
)
def test_a_firefox_that_is_set_otherwise(preferences, experiment, tmp_path):
    opened, link = experiment
    with firefox_tab(tmp_path, **preferences) as tab:
        someone = Visitor(tab)
        tab.go(link)
        someone.begin()
        if "media.autoplay.default" in preferences:
            someone.judge(0.3, by="mouse")
            someone.read_that("Your browser waits for you to play the film")
            assert someone.focus() == "Play the film"
            tab.key("Enter")
            someone.wait("() => document.activeElement.matches('.onward:enabled')")
            tab.key("Enter")
            someone.enter("The practice is over")
        else:
            someone.film()
        someone.judge(0.7, by="keyboard")
        someone.judge(0.2, by="mouse")
        someone.end()
    someone.check(opened)
    assert [one["played"] for one in bodies(opened, "film")] == [True]


@pytest.mark.slow
@pytest.mark.skipif(not BROWSERS["firefox"][1], reason="no firefox")
@pytest.mark.parametrize(("zoom", "fits"), [("1.05", True), ("1.5", False)])
def test_a_page_that_is_enlarged_has_fewer_points(zoom, fits, experiment, tmp_path):
    opened, link = experiment
    with firefox_tab(tmp_path, **{"layout.css.devPixelsPerPx": zoom}) as tab:
        someone = Visitor(tab)
        tab.go(link)
        someone.enter("Welcome")
        someone.enter("Full screen")
        if fits:
            someone.read()
            someone.quiz([1, 0, 1])
            someone.film()
        else:
            someone.see("A look at your screen")
            someone.read_that("zoom out")
    if fits:
        (found,) = trials_table(opened.storage).to_dict("records")
        assert found["pixel_ratio"] == pytest.approx(float(zoom), abs=0.02)
        assert found["window_width"] == pytest.approx(WIDTH / float(zoom), rel=0.005)
