"""A participant in a real browser, who does what the page asks."""

import json
import re

from pourcast.experiment.design.links import link_key
from pourcast.experiment.server.app import create_app
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.storage import Storage


def open_experiment(study, **options):
    """A study's experiment and the application that serves it."""
    experiment = LiveExperiment(study, Storage.of_study(study), **options)
    return experiment, create_app(experiment)


def lab_link(base, experiment):
    return f"{base}/?lab={link_key(experiment.storage.secret, 'lab')}"


class Participant:
    """Somebody with a browser of their own (a context), and what they answered.

    Answers are by the step's number, as the database has them.
    """

    def __init__(self, browser, link, *, script="", **context):
        self.context = browser.new_context(
            **({"viewport": {"width": 1280, "height": 720}} | context)
        )
        self.context.add_init_script(script)  # runs before any of the page's
        self.link = link
        self.answers = []
        self.complaints = []
        self.asked = []
        self.page = self.open()

    def open(self):
        """A new tab."""
        page = self.context.new_page()
        page.set_default_timeout(20_000)
        page.on("console", lambda message: self.complaints.append(message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))
        page.goto(self.link)
        return page

    def see(self, text):
        self.page.get_by_role("heading", name=text).wait_for()

    def press(self, name):
        self.page.get_by_role("button", name=name).click()

    def begin(self, *, keyboard=False):
        """From consent to the first trial."""
        self.see("Welcome")
        if keyboard:
            self.page.keyboard.press("Enter")
        else:
            self.press("I agree")
        self.read(keyboard=keyboard)
        self.quiz([1, 0, 1], keyboard=keyboard)

    def read(self, *, keyboard=False):
        for _ in range(3):
            self.see("What you will do")
            before = self.page.inner_text("#page")
            if keyboard:
                self.page.keyboard.press("Enter")
            else:
                self.press("Continue")
            self.page.wait_for_function(
                "before => document.querySelector('#page').innerText !== before", arg=before
            )

    def quiz(self, choices, *, keyboard=False):
        self.see("Is it all clear?")
        if not keyboard:
            for number, choice in enumerate(choices):
                self.page.locator(f"input[name=q{number}]").nth(choice).check()
            self.press("Check my answers")
            return
        for choice in choices:
            # Arrow keys choose within a question, TAB goes to the next.
            self.page.keyboard.press("Space")
            for _ in range(choice):
                self.page.keyboard.press("ArrowDown")
            self.page.keyboard.press("Tab")
        self.page.keyboard.press("Enter")

    def trial(self):
        """Text above the picture, such as "Trial 3 of 120", when the slider is there."""
        # It has the focus once the picture is to be seen, and hears from then on.
        self.page.locator(".slider:focus").wait_for()
        return self.page.inner_text(".progress")

    def move(self, share):
        """Move the mouse over the slider."""
        box = self.page.locator(".slider").bounding_box()
        self.page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)

    def submit(self):
        before = self.trial()
        self.page.wait_for_timeout(220)  # a key that is held from before is not heard
        self.page.keyboard.press("Enter")
        # What comes next is shown once the answer is on the browser's disk, and no sooner.
        self.page.wait_for_function(
            "before => document.querySelector('.slider')"
            " ? document.querySelector('.progress').innerText !== before"
            " : document.querySelector('#page').innerText.trim()",
            arg=before,
        )

    def judge(self, share):
        """Answer a trial by the mouse."""
        self.trial()
        self.move(share)
        self.answers.append(share)
        self.submit()

    def go_on(self, *, stop_at=None):
        """Do whatever comes, to the end or to a number of answers; returns what was seen."""
        seen = []
        while stop_at is None or len(self.answers) < stop_at:
            self.page.wait_for_selector(".slider, video, textarea, .text h1, #page[data-state]")
            if self.page.query_selector(".slider"):
                seen.append("trial")
                self.judge(round(((7 * len(self.answers)) % 20) / 20, 2))
            elif self.page.query_selector("video"):
                seen.append("film")
                self.page.locator("button:enabled").click(timeout=30_000)
                self.page.wait_for_selector("video", state="detached")
            elif self.page.query_selector("textarea"):
                seen.append("debrief")
                self.page.fill("textarea", "All clear.")
                self.press("Finish")
                self.page.wait_for_selector("#page[data-state]", timeout=60_000)
                return seen
            else:
                seen.append(self.page.inner_text("h1"))
                self.page.locator("button").last.click()
                self.page.wait_for_selector(".text h1", state="detached")
        return seen

    def close(self):
        self.context.close()

    def check(self, *, allow=()):
        """Nothing complained, and nobody else was asked."""
        own = re.match("https?://[^/]*", self.link)[0]
        assert [text for text in self.complaints if not any(a in text for a in allow)] == []
        assert [url for url in self.asked if not url.startswith((own, "blob:", "data:"))] == []


def saved(experiment, session=None):
    """Judgments in the database, by session, in the order of their steps."""
    records = experiment.storage.records()
    return [
        json.loads(record.body)["response"]
        for record in records
        if record.kind == "judgment" and session in (None, record.session)
    ]
