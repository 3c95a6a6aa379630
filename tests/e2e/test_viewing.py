"""What participants see in a real browser: the size of pictures, full screen, films, the questions.

Needs Chromium (Debian: `apt-get install chromium`), and is skipped without.
"""

import json
import shutil

import pytest

from pourcast.experiment.data.tables import trials_table
from pourcast.observers.browser import served
from tests.e2e.participant import Participant, lab_link, open_experiment, saved
from tests.experiment import make

pytestmark = pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no Chromium")

EXP1 = make.EXP1 + "blocks = 1\n"
FULL = EXP1.replace("fullscreen = false\n", "")
LONG = "How much of the water that is held at the top of this container will end up, when it " * 3
LONG_QUESTION = f'{EXP1}[texts.goal]\nquestion = "{LONG}"\n'


@pytest.fixture
def experiment(tmp_path, request):
    """A study of two trials that is served: the experiment and its link."""
    design = getattr(request, "param", EXP1)
    opened, app = open_experiment(make.small_study(tmp_path, scenes=2, design=design))
    with served(app) as base:
        yield opened, lab_link(base, opened)
    opened.close()


def shown(someone):
    """Text of the page."""
    return someone.page.inner_text("#page")


def boxes(someone, *css):
    """Where elements are: left, top, right and bottom edge."""
    return [
        someone.page.evaluate(
            """css => {
              const box = document.querySelector(css).getBoundingClientRect();
              return [box.left, box.top, box.right, box.bottom];
            }""",
            one,
        )
        for one in css
    ]


def assert_all_is_in_the_window(someone, *css):
    width, height, wide, high = someone.page.evaluate(
        """[innerWidth, innerHeight, document.documentElement.scrollWidth,
            document.documentElement.scrollHeight]"""
    )
    assert (wide, high) == (width, height), "the page scrolls"
    for one, (left, top, right, bottom) in zip(css, boxes(someone, *css), strict=True):
        assert min(left, top, width - right, height - bottom) >= 0, one


TRIAL = (".progress", "h1", ".still", ".slider", ".ends", ".shown", ".hint", "button")


@pytest.mark.parametrize(
    ("experiment", "width", "height", "ratio", "picture"),
    [
        (EXP1, 1280, 585, 1.0, 323.0),
        pytest.param(EXP1, 1366, 607, 1.0, 345.0, marks=pytest.mark.slow),  # a laptop's window
        pytest.param(EXP1, 1366, 768, 1.0, 506.0, marks=pytest.mark.slow),  # ... and its screen
        pytest.param(EXP1, 1440, 900, 2.0, 638.0, marks=pytest.mark.slow),
        pytest.param(EXP1, 1536, 703, 1.25, 441.0, marks=pytest.mark.slow),
        pytest.param(EXP1, 1920, 1080, 1.0, 818.0, marks=pytest.mark.slow),
        # The last at 150 % of page zoom.
        pytest.param(EXP1, 1280, 720, 1.5, 458.0, marks=pytest.mark.slow),
        pytest.param(EXP1, 3840, 2160, 1.0, 1898.0, marks=pytest.mark.slow),
        # Of a question of three lines the picture gives way by two of them.
        (LONG_QUESTION, 1280, 585, 1.0, None),
    ],
    indirect=["experiment"],
)
def test_a_trial_fits_the_window_and_says_how_large_the_picture_was(
    experiment, browser, width, height, ratio, picture
):
    opened, link = experiment
    viewport = {"width": width, "height": height}
    someone = Participant(browser, link, viewport=viewport, device_scale_factor=ratio)
    someone.begin()
    someone.trial()
    assert_all_is_in_the_window(someone, *TRIAL)
    (still,) = boxes(someone, ".still")
    someone.judge(0.3)
    assert_all_is_in_the_window(someone, "h1", ".still", "button.onward")
    film = boxes(someone, ".still")[0]
    assert film[3] - film[1] == pytest.approx(still[3] - still[1], abs=0.1)
    someone.go_on(stop_at=2)
    someone.trial()
    someone.move(0.5)
    assert_all_is_in_the_window(someone, *TRIAL)
    someone.go_on()
    table = trials_table(opened.storage)
    assert len(table) == 3
    assert list(table["pixel_ratio"]) == [ratio] * 3
    assert list(table["picture_height"]) == pytest.approx([still[3] - still[1]] * 3, abs=0.1)
    assert list(table["picture_width"]) == pytest.approx([still[2] - still[0]] * 3, abs=0.1)
    if picture is not None:
        assert still[3] - still[1] == pytest.approx(picture, abs=0.5)
    someone.check()
    someone.close()


@pytest.mark.parametrize("experiment", [FULL], indirect=True)
def test_the_screen_is_measured_when_it_is_full(experiment, browser):
    opened, link = experiment
    # A laptop's window with bars and bookmarks: too low for any picture, before it fills the screen.
    someone = Participant(browser, link, viewport={"width": 1366, "height": 560})
    someone.context.add_init_script(
        """const real = Element.prototype.requestFullscreen;
        Element.prototype.requestFullscreen = async function () {
          await real.call(this);
          while (innerHeight !== 768) await new Promise((done) => setTimeout(done, 10));
        };"""
    )
    someone.page.reload()
    someone.see("Welcome")
    someone.press("I agree")
    someone.see("Full screen")
    someone.press("Go to full screen")
    someone.page.wait_for_function("() => document.fullscreenElement !== null")
    someone.page.set_viewport_size({"width": 1366, "height": 768})
    someone.read()
    someone.quiz([1, 0, 1])
    someone.go_on()
    someone.page.wait_for_function("() => document.fullscreenElement === null")
    bodies = [json.loads(r.body) for r in opened.storage.records() if r.kind == "check"]
    assert [(one["window_height"], one["tries"]) for one in bodies] == [(768, 1)]
    someone.check()
    someone.close()


@pytest.mark.parametrize("experiment", [FULL], indirect=True)
def test_full_screen_that_was_left_is_asked_for_again(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.see("Welcome")
    someone.press("I agree")
    someone.see("Full screen")
    assert "fills the whole screen" in shown(someone)
    someone.press("Go to full screen")
    someone.read()
    someone.quiz([1, 0, 1])
    someone.trial()
    someone.page.evaluate("document.exitFullscreen()")  # what ESC does
    someone.page.wait_for_function("() => document.fullscreenElement === null")
    # The trial itself is not disturbed.
    someone.move(0.3)
    someone.answers.append(0.3)
    someone.page.wait_for_timeout(220)
    someone.page.keyboard.press("Enter")
    someone.see("Full screen")
    assert "You left full screen" in shown(someone)
    someone.page.locator("button:focus", has_text="Go to full screen").wait_for()
    someone.page.keyboard.press("Enter")
    someone.page.wait_for_selector("video")
    assert someone.page.evaluate("document.fullscreenElement !== null")
    someone.page.reload()
    someone.press("Go on")
    someone.press("Go to full screen")
    someone.go_on()
    assert saved(opened) == pytest.approx(someone.answers, abs=0.004)
    someone.check()
    someone.close()


REFUSED = "Element.prototype.requestFullscreen = () => Promise.reject(new TypeError('no'));"
NONE = """Object.defineProperty(Document.prototype, "fullscreenEnabled", { get: () => false });"""


@pytest.mark.parametrize("experiment", [FULL], indirect=True)
@pytest.mark.parametrize("refuses", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_nobody_is_kept_out_by_a_browser_that_does_not_fill_the_screen(
    experiment, browser, refuses
):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.context.add_init_script(REFUSED if refuses else NONE)
    someone.page.reload()
    someone.see("Welcome")
    someone.press("I agree")
    if refuses:
        for _ in range(2):
            someone.press("Go to full screen")
            someone.page.get_by_text("Your browser did not fill the screen").wait_for()
        someone.press("Go on without")
    someone.read()
    someone.quiz([1, 0, 1])
    someone.go_on()  # and is not asked again
    assert opened.storage.sessions()[0].state == "complete"
    someone.check()
    someone.close()


@pytest.mark.parametrize("leaves", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_window_that_is_made_too_small_is_told_of_before_the_next_trial(
    experiment, browser, leaves
):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.trial()
    someone.page.set_viewport_size({"width": 1280, "height": 600})
    someone.page.wait_for_timeout(300)
    as_ever = someone.page.locator(".still").bounding_box()["height"]
    someone.page.set_viewport_size({"width": 1280, "height": 500})
    someone.judge(0.5)
    someone.see("A look at your screen")
    assert "1280 x 500" in shown(someone)
    if leaves:
        someone.press("I can't")
        someone.page.wait_for_selector("#page[data-state=screened_out]")
    else:
        someone.page.set_viewport_size({"width": 1280, "height": 600})
        someone.press("Try again")
        someone.see("This is what happens")
        someone.go_on()
        # As large as ever in a window of this size: what did not fit in the other one is past.
        heights = list(trials_table(opened.storage)["picture_height"])[1:]
        assert heights == pytest.approx([as_ever, as_ever], abs=1.0)
    assert saved(opened) == pytest.approx(someone.answers, abs=0.004)
    someone.close()


def test_wrong_answers_are_told_of_on_the_page_that_follows(experiment, browser):
    _, link = experiment
    someone = Participant(browser, link)
    someone.see("Welcome")
    someone.press("I agree")
    for left, wrong in ((2, 1), (1, 3)):
        someone.read()
        assert someone.page.locator(".notice").count() == 0
        someone.quiz([0, 0, 1] if wrong == 1 else [0, 1, 0], keyboard=True)
        someone.page.get_by_role("alert").wait_for()
        someone.see("What you will do")
        said = someone.page.inner_text(".notice")
        assert "Not all of your answers were right" in said
        assert "What do you judge?" in said
        assert someone.page.locator(".notice li").count() == wrong
        assert f"tries left: {left}" in said
        someone.page.locator(".notice:focus").wait_for()
    # ENTER goes on from there.
    someone.read(keyboard=True)
    someone.quiz([1, 0, 1])
    someone.trial()
    someone.check()
    someone.close()


def test_a_key_that_is_held_down_presses_one_button(experiment, browser):
    _, link = experiment
    someone = Participant(browser, link)
    someone.see("Welcome")
    title = someone.page.get_by_role("heading", name="What you will do")
    for _ in range(500):  # all but the first are repetitions
        someone.page.keyboard.down("Enter")
        if title.is_visible():
            break
    for _ in range(20):
        someone.page.keyboard.down("Enter")
    someone.page.keyboard.up("Enter")
    assert "Each picture shows" in shown(someone)
    someone.close()


BLOCKED = """
const real = HTMLMediaElement.prototype.play;
let pressed = false;
addEventListener("click", (event) => (pressed ||= event.target.matches(".play")), true);
HTMLMediaElement.prototype.play = function () {
  return pressed ? real.call(this) : Promise.reject(new DOMException("no", "NotAllowedError"));
};
"""
"""Autoplay as it is refused in low-power mode, or by a setting: only a press plays."""


@pytest.mark.parametrize("key", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_film_that_may_not_begin_by_itself_is_played_by_a_press(experiment, browser, key):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.context.add_init_script(BLOCKED)
    someone.page.reload()
    someone.begin()
    someone.judge(0.5)
    someone.page.get_by_text("Your browser waits for you to play the film").wait_for()
    someone.page.locator("button:focus", has_text="Play the film").wait_for()
    assert someone.page.get_by_role("button", name="Continue").count() == 0
    someone.page.keyboard.press("Enter") if key else someone.press("Play the film")
    someone.go_on()
    films = [json.loads(r.body) for r in opened.storage.records() if r.kind == "film"]
    assert [one["played"] for one in films] == [True]
    someone.check()
    someone.close()


HIDE = """hidden => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


def test_a_film_waits_while_its_tab_is_hidden(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    # Long enough to be hidden in the middle.
    someone.context.add_init_script(
        """const real = HTMLMediaElement.prototype.play;
        HTMLMediaElement.prototype.play = function () {
          this.playbackRate = 0.0625;
          return real.call(this);
        };"""
    )
    someone.page.reload()
    someone.begin()
    someone.judge(0.5)
    someone.page.wait_for_function("() => document.querySelector('video')?.currentTime > 0")
    someone.page.evaluate(HIDE, True)
    someone.page.wait_for_function("() => document.querySelector('video').paused")
    assert someone.page.locator(".play").is_hidden()
    someone.page.evaluate(HIDE, False)
    someone.page.wait_for_function("() => !document.querySelector('video').paused")
    # What the browser stops for other reasons has a button.
    someone.page.evaluate("document.querySelector('video').pause()")
    someone.press("Play the film")
    someone.page.evaluate("document.querySelector('video').playbackRate = 16")
    someone.go_on()
    films = [json.loads(r.body) for r in opened.storage.records() if r.kind == "film"]
    assert [one["played"] for one in films] == [True]
    someone.check()
    someone.close()
