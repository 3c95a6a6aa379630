"""The experiment in a real browser: from consent to the end, and what is saved of it.

Needs Chromium (Debian: `apt-get install chromium`), and is skipped without. What only few
participants meet is among the slow tests, which CI runs, too.
"""

import json
import shutil
import subprocess
import sys
import threading
import time
import zipfile
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pandas as pd
import pytest

from pourcast import cli
from pourcast.experiment.data.tables import trials_table
from pourcast.experiment.design.links import link_key
from pourcast.experiment.server.app import create_app
from pourcast.experiment.storage.storage import Storage
from pourcast.observers.browser import drive_observers, served
from pourcast.observers.rehearsal import Rehearsal
from tests.e2e.participant import Participant, lab_link, open_experiment, saved
from tests.e2e.services import JATOS, DataPipe
from tests.experiment.make import EXP1, EXP2, small_study

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no Chromium")


@pytest.fixture
def experiment(tmp_path, request):
    """A small study that is served: the experiment and its link."""
    kind, design = getattr(request, "param", ("exp1", EXP1))
    opened, app = open_experiment(small_study(tmp_path, kind, design=design))
    with served(app) as base:
        yield opened, lab_link(base, opened)
    opened.close()


def close_to(answers):
    return pytest.approx(answers, abs=0.004)


def judgments(experiment, count, kind="judgment"):
    """Bodies of the judgments (or another kind of record), when there are so many."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        found = [json.loads(r.body) for r in experiment.storage.records() if r.kind == kind]
        if len(found) >= count:
            return found
        time.sleep(0.02)
    raise AssertionError(f"{len(found)} of {count} came")


FULL = EXP1.replace("fullscreen = false\n", "")


@pytest.mark.parametrize(
    ("experiment", "trials", "blocks"),
    [(("exp1", FULL), 6, [2, 2, 2]), (("exp2", EXP2), 12, [4, 4, 4])],
    indirect=["experiment"],
)
def test_an_experiment_from_consent_to_the_end(experiment, browser, trials, blocks):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.see("Welcome")
    someone.press("I agree")
    if opened.design.fullscreen:
        someone.press("Go to full screen")
        someone.page.wait_for_function("document.fullscreenElement !== null")
    someone.read()
    someone.quiz([1, 0, 1])
    seen = someone.go_on()
    breaks = []
    for size in blocks:
        breaks += ["trial"] * size + ["Time for a break"]
    # A film follows practice, and nothing else does.
    assert seen == ["trial", "film", "The practice is over", *breaks[:-1], "debrief"]
    assert someone.page.get_attribute("#page", "data-state") == "complete"
    someone.see("Thank you!")
    assert saved(opened) == close_to(someone.answers)
    assert len(someone.answers) == trials + 1
    session = opened.storage.sessions()[0]
    assert session.state == "complete"
    assert opened.storage.saved_steps(session.number) == list(range(len(session.steps)))
    assert opened.storage.conflicts() == []
    someone.check()
    someone.close()


def test_all_of_it_by_keyboard_alone(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin(keyboard=True)
    page = someone.page
    assert someone.trial() == "Practice 1 of 1"
    slider = page.get_by_role("slider", name="Share of the liquid in the right basin")
    assert slider.evaluate("element => element === document.activeElement")
    assert page.get_by_role("button", name="Hand in").is_disabled()
    page.keyboard.press("Enter")  # nothing to hand in yet
    assert page.locator(".handle").is_hidden()
    for name, value in (
        ("ArrowRight", 51), ("ArrowLeft", 50), ("PageUp", 60), ("PageDown", 50),
        ("Shift+ArrowRight", 60), ("Home", 0), ("ArrowLeft", 0), ("End", 100), ("ArrowDown", 99),
    ):  # fmt: skip
        page.keyboard.press(name)
        assert slider.get_attribute("aria-valuenow") == str(value)
    assert slider.get_attribute("aria-valuetext") == "left 1 %, right 99 %"
    someone.submit()
    page.locator("button:enabled").wait_for()
    page.keyboard.press("Enter")  # the film's button has the focus
    someone.see("The practice is over")
    page.keyboard.press("Enter")
    someone.trial()
    page.keyboard.press("ArrowLeft")
    someone.submit()
    assert [one["response"] for one in judgments(opened, 2)] == [0.99, 0.49]
    someone.check()
    someone.close()


def test_the_slider_follows_the_mouse_and_a_finger(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link, has_touch=True)
    someone.begin()
    someone.trial()
    page = someone.page
    box = page.locator(".slider").bounding_box()
    page.touchscreen.tap(box["x"] + 0.25 * box["width"], box["y"] + 10)
    assert page.get_by_role("slider").get_attribute("aria-valuenow") == "25"
    page.get_by_role("button", name="Hand in").tap()
    page.locator("button:enabled").click()
    someone.see("The practice is over")
    someone.press("Begin")
    someone.trial()
    someone.move(0.9)
    someone.move(0.75)
    page.mouse.move(5, 5)  # beside the slider it stays where it is
    assert page.inner_text(".shown p") == "left 25 %, right 75 %"
    someone.submit()
    table = judgments(opened, 2)
    assert [one["input"] for one in table] == ["touch", "mouse"]
    assert [one["response"] for one in table] == close_to([0.25, 0.75])
    assert table[1]["moves"] >= 2
    assert table[1]["rt"] >= table[1]["first_move"] > 0
    assert [one["start"] for one in table] == [None, None]
    someone.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    "experiment",
    [("exp1", EXP1 + '[slider]\nstart = "fixed"\nstart_at = 0.3\nmouse = "drag"\nnumber = false\ntrajectory = true\n')],
    indirect=True,
)  # fmt: skip
def test_a_start_a_drag_and_the_whole_way_are_choices(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.trial()
    slider = someone.page.get_by_role("slider")
    assert slider.get_attribute("aria-valuenow") == "30"
    assert someone.page.locator(".shown p").count() == 0
    someone.move(0.9)
    assert slider.get_attribute("aria-valuenow") == "30"
    someone.page.mouse.down()
    someone.move(0.6)
    someone.page.mouse.up()
    someone.move(0.1)
    assert slider.get_attribute("aria-valuenow") == "60"
    someone.submit()
    (body,) = judgments(opened, 1)
    assert body["start"] == 0.3
    way = [place for _, place in body["trajectory"]]
    assert way[0] == close_to(0.9)
    assert way[-1] == close_to(0.6)
    assert body["moves"] == len(way)
    someone.close()


def test_a_reload_goes_on_at_the_next_trial(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.go_on(stop_at=2)
    someone.trial()
    someone.page.reload()
    someone.see("Welcome back")
    assert "2 of 7 trials" in someone.page.inner_text("#page")
    someone.press("Go on")
    someone.go_on()
    assert saved(opened) == close_to(someone.answers)
    assert opened.storage.conflicts() == []
    assert len(opened.storage.sessions()) == 1
    someone.check()
    someone.close()


@pytest.mark.slow
def test_a_reload_during_a_film_shows_the_film_again_and_asks_nothing_twice(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.judge(0.5)
    someone.page.wait_for_selector("video")
    someone.page.reload()
    someone.see("Welcome back")
    someone.press("Go on")
    someone.see("This is what happens")
    someone.go_on()
    assert saved(opened) == close_to(someone.answers)
    someone.close()


def test_two_tabs_are_recognised_and_one_takes_over(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.judge(0.5)
    first = someone.page
    second = someone.open()
    someone.page = second
    someone.see("The study is open in another window")
    # A tab that is only opened, and left, takes nothing away; nor is what the first one could
    # not send yet asked for again.
    someone.page = first
    someone.see("This is what happens")
    first.route("**/api/session/records/*", lambda route: route.abort())
    someone.go_on(stop_at=2)
    someone.page = second
    someone.press("Go on here")
    first.get_by_text("You went on in another window").wait_for()
    someone.see("Welcome back")
    someone.press("Go on")
    someone.go_on()
    assert saved(opened) == close_to(someone.answers)
    assert len(opened.storage.sessions()) == 1
    someone.check(allow=["ERR_FAILED"])
    someone.close()


@pytest.mark.slow
def test_the_next_participant_at_the_same_computer_begins_anew(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.go_on()
    someone.page.goto(link)
    someone.see("Welcome")
    assert len(opened.storage.sessions()) == 2
    someone.close()


@pytest.mark.slow
def test_at_an_abandoned_computer_somebody_else_begins_anew(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.judge(0.5)
    someone.page.reload()
    someone.see("Welcome back")
    someone.press("I am somebody else")
    someone.see("Welcome")
    someone.answers.clear()
    someone.begin()
    someone.go_on()
    first, second = opened.storage.sessions()
    assert (first.state, second.state) == ("open", "complete")
    assert saved(opened, first.number) == close_to([0.5])
    assert saved(opened, second.number) == close_to(someone.answers)
    someone.close()


@pytest.mark.slow
def test_who_fails_the_questions_three_times_is_sent_away(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.see("Welcome")
    someone.press("I agree")
    for _ in range(3):
        someone.read()
        someone.quiz([0, 0, 0])
    someone.page.wait_for_selector("#page[data-state=failed_check]")
    assert opened.storage.sessions()[0].state == "failed_check"
    someone.close()


def test_who_declines_leaves_nothing(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    someone.see("Welcome")
    someone.press("I do not want to take part")
    someone.page.wait_for_selector("#page[data-state=declined]")
    assert opened.storage.sessions() == []
    someone.close()


def test_a_small_screen_is_told_of_and_can_be_made_larger(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link, viewport={"width": 1000, "height": 600})
    someone.see("Welcome")
    someone.press("I agree")
    someone.see("A look at your screen")
    assert "1000 x 600" in someone.page.inner_text("#page")
    someone.press("Try again")
    someone.see("A look at your screen")
    someone.page.set_viewport_size({"width": 1300, "height": 800})
    someone.press("Try again")
    someone.see("What you will do")
    (check,) = judgments(opened, 1, "check")
    assert check["tries"] == 3
    someone.close()


@pytest.mark.slow
def test_prolifics_participants_get_the_code_and_the_way_back(tmp_path, browser):
    codes = '[recruiting]\ncomplete = "DONE1"\nredirect = "https://app.example.org/?cc={code}"\n'
    opened, app = open_experiment(small_study(tmp_path, scenes=2, design=EXP1 + codes))
    with served(app) as base:
        someone = Participant(browser, f"{base}/?PROLIFIC_PID=p1&STUDY_ID=s&SESSION_ID=t")
        someone.begin()
        someone.go_on()
        assert someone.page.inner_text(".code") == "DONE1"
        link = someone.page.get_by_role("link", name="Take me back")
        assert link.get_attribute("href") == "https://app.example.org/?cc=DONE1"
        someone.page.reload()
        assert someone.page.inner_text(".code") == "DONE1"
        other = Participant(browser, f"{base}/?PROLIFIC_PID=p1&STUDY_ID=s&SESSION_ID=u")
        other.page.get_by_text("You have taken part in this study before").wait_for()
        someone.close()
        other.close()
    opened.close()


@pytest.mark.slow
def test_no_text_is_set_before_its_words_are_escaped(tmp_path, browser):
    own = '[texts.consent]\nbody = "<img src=x onerror=alert(1)> & <b>bold</b>"\n'
    opened, app = open_experiment(small_study(tmp_path, design=EXP1 + own))
    with served(app) as base:
        someone = Participant(browser, lab_link(base, opened))
        someone.see("Welcome")
        assert "<img src=x onerror=alert(1)> & <b>bold</b>" in someone.page.inner_text("#page")
        assert someone.page.locator("#page img").count() == 0
        someone.check()
        someone.close()
    opened.close()


def test_the_trial_fits_on_the_smallest_screen(experiment, browser):
    _, link = experiment
    someone = Participant(browser, link)
    someone.begin()
    someone.trial()
    someone.move(0.5)
    height, width = someone.page.evaluate(
        "[document.documentElement.scrollHeight, document.documentElement.scrollWidth]"
    )
    assert height <= 720
    assert width <= 1280
    someone.close()


def test_simulated_observers_take_part_through_the_page(tmp_path, browser):
    opened, _ = open_experiment(small_study(tmp_path, "exp1"))
    table = pd.DataFrame(
        [
            {"participant": f"sim-{who}", "scene": scene.id, "liquid": "water", "rt": 1.5,
             "response": round(0.1 * k + 0.03 * who, 2)}
            for who in range(2)
            for k, scene in enumerate(opened.scenes)
        ]
    )  # fmt: skip
    app = create_app(opened, rehearsal=Rehearsal(table, opened.scenes))
    with served(app) as base:
        drive_observers(browser, base, link_key(opened.storage.secret, "simulation"), 2)
    sessions = opened.storage.sessions()
    assert [one.state for one in sessions] == ["complete", "complete"]
    assert {one.entry for one in sessions} == {"simulation"}
    found = trials_table(opened.storage)
    found = found[found["phase"] == "test"].merge(table, on="scene", suffixes=("", "_meant"))
    who = found["session"].map({sessions[k].number: f"sim-{k}" for k in range(2)})
    found = found[found["participant_meant"] == who]
    assert len(found) == 12
    assert (found["response"] == found["response_meant"]).all()
    assert (found["rt"] == 1.5).all()
    assert found["simulated"].all()
    opened.close()


def test_the_command_lets_observers_take_part_and_says_where_their_answers_are(tmp_path):
    study = small_study(tmp_path, scenes=2)
    # In a process of its own, as Playwright runs once in each.
    command = [sys.executable, "-m", "pourcast", "experiment", "simulate", str(study)]
    command += ["--browser", "--observers", "2", "-m", "gravity"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said == f"{study / 'responses.sqlite'}: 2 simulated observers took part\n"
    storage = Storage.of_study(study)
    sessions = [(one.entry, one.state) for one in storage.sessions()]
    assert sessions == 2 * [("simulation", "complete")]
    assert len(trials_table(storage)) == 2 * (1 + 2)
    storage.close()


@pytest.mark.slow
def test_observers_can_be_watched(tmp_path, browser):
    opened, _ = open_experiment(small_study(tmp_path, scenes=2))
    table = pd.DataFrame(
        {"participant": "sim-0", "scene": [one.id for one in opened.scenes], "liquid": "water",
         "response": [0.2, 0.9], "rt": 0.7}
    )  # fmt: skip
    with served(create_app(opened, rehearsal=Rehearsal(table, opened.scenes))) as base:
        link = link_key(opened.storage.secret, "simulation")
        drive_observers(browser, base, link, 1, visual=True)
    found = {
        step.scene: body["response"]
        for step, body in zip(
            [s for s in opened.storage.sessions()[0].steps if s.kind == "judgment"],
            judgments(opened, 3),
            strict=True,
        )
    }
    assert [found[one.id] for one in opened.scenes] == close_to([0.2, 0.9])
    assert judgments(opened, 1, "film")[0]["played"]
    opened.close()


@contextmanager
def web_host(folder):
    """A plain web server, as any web host is."""
    handler = partial(QuietHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


def imported(study, path, tmp_path):
    assert cli.run(["experiment", "data", str(study), "--import", str(path)]) == 0
    storage = Storage.of_study(study)
    (session,) = storage.sessions()
    answers = [json.loads(r.body)["response"] for r in storage.records() if r.kind == "judgment"]
    storage.close()
    assert session.state == "complete"
    return session, answers


def test_a_static_page_offers_its_answers_as_a_file(tmp_path, browser):
    study = small_study(tmp_path / "s", scenes=3)
    export = ["experiment", "export", str(study), "--static", str(tmp_path / "web")]
    assert cli.run(export) == 0
    with web_host(tmp_path / "web") as base:
        someone = Participant(browser, f"{base}/index.html?PROLIFIC_PID=p9", accept_downloads=True)
        someone.begin()
        someone.go_on(stop_at=2)
        someone.page.reload()
        someone.see("Welcome back")
        someone.press("Go on")
        someone.go_on()
        assert someone.page.get_attribute("#page", "data-state") == "file"
        # It is offered as long as the page can be loaded; nothing begins anew unasked.
        someone.page.reload()
        someone.page.wait_for_selector("#page[data-state=file]")
        with someone.page.expect_download() as download:
            someone.page.get_by_role("link", name="Download my answers").click()
        assert download.value.suggested_filename.endswith(".json")
        download.value.save_as(tmp_path / "answers.json")
        someone.check()
        someone.close()
    session, answers = imported(study, tmp_path / "answers.json", tmp_path)
    assert answers == close_to(someone.answers)
    assert session.entry == "static"
    assert session.identifiers == {"PROLIFIC_PID": "p9"}


@contextmanager
def page_with_datapipe(tmp_path, browser, datapipe):
    """A study that is exported for DataPipe, and somebody whose page sends it answers."""
    study = small_study(tmp_path / "s", scenes=2)
    export = ["experiment", "export", str(study), "--static", str(tmp_path / "web")]
    assert cli.run([*export, "--datapipe", datapipe.experiment]) == 0
    with web_host(tmp_path / "web") as base:
        someone = Participant(browser, f"{base}/index.html")
        someone.page.route("https://pipe.jspsych.org/**", datapipe.answer)
        yield study, someone
        someone.close()


def sent(datapipe, study, tmp_path):
    """The one file that DataPipe got, imported: the session, its answers and the file's name."""
    ((name, content),) = datapipe.files.items()
    (tmp_path / name).write_text(content)
    return *imported(study, tmp_path / name, tmp_path), name


@pytest.mark.slow
def test_a_static_page_sends_its_answers_to_datapipe(tmp_path, browser):
    datapipe = DataPipe()
    # As networks do, as the storage behind it does, and as networks do.
    datapipe.fates = [(503, "DATA_PERSIST_ERROR"), (400, "UPLOAD_ERROR"), "lost"]
    with page_with_datapipe(tmp_path, browser, datapipe) as (study, someone):
        someone.begin()
        someone.go_on()
        assert someone.page.get_attribute("#page", "data-state") == "complete"
        # Loaded again it is over; somebody else at this computer can begin.
        someone.page.reload()
        someone.see("Thank you!")
        someone.press("I am somebody else")
        someone.see("Welcome")
    assert datapipe.asked == 4
    session, answers, name = sent(datapipe, study, tmp_path)
    assert answers == close_to(someone.answers)
    assert name == f"{session.key}.json"


@pytest.mark.slow
def test_a_datapipe_that_is_not_switched_on_is_told_of(tmp_path, browser):
    datapipe = DataPipe()
    datapipe.active = False
    with page_with_datapipe(tmp_path, browser, datapipe) as (study, someone):
        someone.begin()
        someone.go_on()
        for _ in range(2):
            assert someone.page.get_attribute("#page", "data-state") == "refused"
            said = someone.page.inner_text("#page")
            assert "is not switched on for this study. Trying again would not help." in said
            assert "goes on trying" not in said
            someone.page.get_by_role("link", name="Download my answers").wait_for()
            someone.page.reload()
            someone.page.wait_for_selector("#page[data-state]")
        assert datapipe.asked == 3
        datapipe.active = True
        someone.page.reload()
        someone.page.wait_for_selector("#page[data-state=complete]")
    assert sent(datapipe, study, tmp_path)[1] == close_to(someone.answers)


@pytest.mark.slow
def test_answers_that_somebody_left_are_sent_when_they_can_be(tmp_path, browser):
    datapipe = DataPipe()
    datapipe.active = False
    with page_with_datapipe(tmp_path, browser, datapipe) as (study, someone):
        someone.begin()
        someone.go_on()
        someone.press("I am somebody else")
        someone.see("Welcome")
        datapipe.active = True
        with someone.page.expect_response("https://pipe.jspsych.org/**"):
            someone.page.reload()
        someone.see("Welcome")
        before = datapipe.asked
        someone.page.reload()
        someone.see("Welcome")
        someone.page.wait_for_timeout(500)
        assert datapipe.asked == before  # once it is there, nobody is asked again
    assert sent(datapipe, study, tmp_path)[1] == close_to(someone.answers)


def test_jatos_gets_each_answer_as_it_comes(tmp_path, browser):
    study = small_study(tmp_path / "s", scenes=3)
    assert cli.run(["experiment", "export", str(study), "--jatos", str(tmp_path / "a.jzip")]) == 0
    with zipfile.ZipFile(tmp_path / "a.jzip") as jzip:
        jzip.extractall(tmp_path / "jatos")
    (folder,) = [path for path in (tmp_path / "jatos").iterdir() if path.is_dir()]
    (folder / "jatos.js").write_text(JATOS)
    script = 'sessionStorage.failing ??= "offline fine offline 500 lost fine fine lost";'
    with web_host(folder) as base:
        someone = Participant(browser, f"{base}/index.html", script=script)
        someone.begin()
        someone.go_on(stop_at=2)
        someone.page.reload()
        someone.see("Welcome back")
        someone.press("Go on")
        # At the end, too, when jatos.js could not say so.
        someone.page.evaluate("sessionStorage.failing = 'fine lost offline'")
        someone.go_on()
        assert someone.page.get_attribute("#page", "data-state") == "complete"
        results = someone.page.evaluate("sessionStorage.results")
        someone.check()
        someone.close()
    (tmp_path / "results.txt").write_text(results)
    lines = [json.loads(line) for line in results.splitlines()]
    assert [line["seq"] for line in lines if "seq" in line][:2] == [0, 0]
    placed = {(line["session"], line["group"], line["place"]) for line in lines}
    assert len(placed) == 1
    session, answers = imported(study, tmp_path / "results.txt", tmp_path)
    assert answers == close_to(someone.answers)
    assert session.entry == "jatos"
    assert session.participant not in ("p7", "")


AXE = ROOT / "src/pourcast/experiment/page/web/node_modules/axe-core/axe.min.js"


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is there once the page has been built")
def test_every_page_is_accessible_as_far_as_axe_can_tell(experiment, browser):
    _, link = experiment
    # Without motion, as a button that has just come to life fades in.
    someone = Participant(browser, link, bypass_csp=True, reduced_motion="reduce")
    page = someone.page

    def examine(where):
        page.add_script_tag(path=AXE)
        found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
        assert [(one["id"], one["nodes"][0]["html"]) for one in found] == [], where

    someone.see("Welcome")
    examine("consent")
    someone.press("I agree")
    someone.see("What you will do")
    examine("instructions")
    someone.read()
    someone.see("Is it all clear?")
    examine("questions")
    someone.quiz([1, 0, 1])
    someone.trial()
    examine("a trial")
    someone.move(0.3)
    examine("an answer")
    someone.answers.append(0.3)
    someone.submit()
    page.wait_for_selector("video")
    examine("film")
    someone.go_on(stop_at=3)
    someone.see("Time for a break")
    examine("break")
    someone.close()


@pytest.mark.slow
def test_files_that_stall_are_fetched_again_and_the_participant_is_told(experiment, browser):
    opened, link = experiment
    someone = Participant(browser, link)
    refused = []

    def refuse(route):
        refused.append(route.request.url)
        if len(refused) > 12:
            route.continue_()
        else:
            route.abort()

    someone.page.route("**/media/*", refuse)
    someone.begin()
    someone.page.get_by_text("Loading pictures").wait_for()
    someone.go_on()
    assert saved(opened) == close_to(someone.answers)
    assert len(refused) > 12
    someone.close()
