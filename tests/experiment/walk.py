"""A random walk: people come, answer, leave and are withdrawn, and whatever can go wrong does.

`walk_oracle` knows what each person was told; `walk_world` is the server, and its death.
"""

import json
import os
import shutil
import tempfile
from collections import Counter
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from pourcast.experiment.design.links import link_key
from tests.experiment.make import answer
from tests.experiment.walk_oracle import COMPLETE, Oracle, personal
from tests.experiment.walk_world import AT_THE_ANSWER, Request, World

GAP = 3600.0
DESIGN = f"""
groups = [["water"], ["honey"]]
practice = 1
blocks = 2
order = "own"
fullscreen = false
largest_gap = {GAP}
[recruiting]
redirect = "https://app.example.org/?cc={{code}}"
"""
MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
"""Where files are, if it can be: who is killed needs no disk, and waits for none there."""

HOUR, DAY = 3600.0, 86400.0

HEARD, REQUEST_LOST, ANSWER_LOST = "heard", "the request is lost", "the answer is lost"


def _fate(number):
    """What becomes of a request: mostly it is answered; else it, its answer or the server dies."""
    if number < 70:
        return HEARD
    if number < 77:
        return REQUEST_LOST
    if number < 84:
        return ANSWER_LOST
    return AT_THE_ANSWER if number == 84 else number - 84


FATES = st.integers(0, 110).map(_fate)
DEATHS = st.sampled_from([None] * 3) | st.integers(1, 60)
PEOPLE = st.integers(0, 9)


@dataclass
class Browser:
    """Somebody's browser: what it knows."""

    request: str
    link: dict
    tabs: list
    token: str = ""
    key: str = ""
    steps: list = field(default_factory=list)
    outbox: dict = field(default_factory=dict)
    saved: set = field(default_factory=set)
    refusals: int = 0

    @property
    def tab(self):
        """The tab that was opened last."""
        return self.tabs[-1]


class Walk(RuleBasedStateMachine):
    """People, and what happens to them and to the server."""

    template: Path
    database = staticmethod(nullcontext)
    tally: Counter

    def __init__(self):
        super().__init__()
        self.resources = ExitStack()
        folder = Path(self.resources.enter_context(tempfile.TemporaryDirectory(dir=MEMORY)))
        study = shutil.copytree(self.template, folder / "study")
        self.world = World(study, self.resources.enter_context(self.database()))
        self.resources.callback(self.world.stop)
        self.oracle = Oracle(self.world, GAP)
        self.browsers = []
        self.past = []
        self.sent = []
        self.tally["walks"] += 1
        self.counts = dict.fromkeys(("browser", "answer"), 0)

    def teardown(self):
        """The last look at it."""
        try:
            self.oracle.check()
            self.oracle.check_nothing_is_left()
        finally:
            self.tally.update(self.oracle.seen)
            self.tally["starts"] += self.world.starts
            self.resources.close()

    # People --------------------------------------------------------------------------

    def _count(self, what):
        self.counts[what] += 1
        return self.counts[what]

    def _browser(self, kind, other):
        number = self._count("browser")
        lab = link_key(self.world.storage.secret, "lab")
        link = {
            "lab": {"lab": lab},
            "named": {"lab": lab, "participant": f"name-of-{number:04}-person"},
            "preview": {"preview": link_key(self.world.storage.secret, "preview")},
            "prolific": {
                "PROLIFIC_PID": f"pid-of-{number:04}-person", "STUDY_ID": "study-1",
                "SESSION_ID": f"visit-{number:04}",
            },
        }.get(kind)  # fmt: skip
        if kind == "twin":
            link = dict(self.browsers[other % len(self.browsers)].link)
        return Browser(f"request-{number:04}-word", link, [f"tab-{number:04}-1"])

    KINDS = st.sampled_from(["prolific", "lab", "named", "preview", "twin"])

    @initialize(kinds=st.lists(KINDS.filter(lambda k: k != "twin"), min_size=3, max_size=10))
    def people_come(self, kinds):
        self.browsers = [self._browser(kind, 0) for kind in kinds]
        for browser in self.browsers:
            self._begin(browser, HEARD)

    def _of(self, number):
        """Somebody who takes part; who is told that they don't makes room for another."""
        slot = number % len(self.browsers)
        browser = self.browsers[slot]
        if browser.refusals > 1:
            kinds = ("prolific", "lab", "named", "preview")
            browser = self.browsers[slot] = self._browser(kinds[self.counts["browser"] % 4], 0)
        if not browser.token:
            self._begin(browser, HEARD)
            # While the place is theirs alone: whoever was given up may come back to it next.
            self.oracle.check()
        return browser

    # Requests ------------------------------------------------------------------------

    def _send(self, requests, fate):
        """Send requests at the same time; the answers that browsers hear, None for others."""
        self.oracle.pass_time(1.0)
        self.sent += requests
        if fate == REQUEST_LOST:
            return [None] * len(requests)
        kill = None if fate in (HEARD, ANSWER_LOST) else fate
        answers = self.world.ask(requests, kill)
        known = [one for one in zip(requests, answers, strict=True) if one[1].heard]
        # Of those that came at the same time, one was the first.
        for request, told in sorted(known, key=lambda one: b'"new"' not in one[1].body):
            self.oracle.answered(request, told)
        if kill is not None:
            lost = zip(requests, answers, strict=True)
            self.oracle.settle([request for request, told in lost if not told.heard])
        return [told if told.heard and fate != ANSWER_LOST else None for told in answers]

    def _begin(self, browser, fate):
        content = {"request": browser.request, "tab": browser.tab, "link": browser.link}
        [told] = self._send([Request("begin", "POST", "/api/sessions", content)], fate)
        if told is not None and told.status == 201:
            said = told.said
            browser.token, browser.key = said["token"], said["key"]
            browser.steps, browser.saved = said["steps"], set(said["done"])

    def _post(self, browser, what, content, fate):
        path = f"/api/session/{what}"
        [told] = self._send([Request(what, "POST", path, content, browser.token)], fate)
        browser.refusals += told is not None and told.status == 401
        return told

    def _finish(self, browser, state, fate, tab=None):
        if browser.token:
            self._post(browser, "finish", {"state": state, "tab": tab or browser.tab}, fate)

    def _record(self, browser, seq, body, tab=None):
        content = {"tab": tab or browser.tab, "body": body}
        return Request("save", "PUT", f"/api/session/records/{seq}", content, browser.token)

    def _put(self, browser, seq, body, fate, tab=None):
        [told] = self._send([self._record(browser, seq, body, tab)], fate)
        self._hear(browser, seq, told)

    def _hear(self, browser, seq, told):
        if told is not None and told.status == 200:
            browser.saved.add(seq)
        browser.refusals += told is not None and told.status == 401

    def _new_body(self, browser, seq):
        """An answer that nobody else gives, nor anybody again."""
        number = self._count("answer")
        body = answer(browser.steps[seq]["kind"], number % 1000 / 1000) | {"rt": number / 1000}
        return body | ({"remarks": f"remark-{number:06}-text"} if "remarks" in body else {})

    def _next(self, browser):
        """The next step that this browser has no answer saved of, and its answer."""
        waiting = [step["seq"] for step in browser.steps if step["seq"] not in browser.saved]
        seq = waiting[0] if waiting else 0
        if seq not in browser.outbox:
            browser.outbox[seq] = self._new_body(browser, seq)
        return seq, browser.outbox[seq]

    # Rules ---------------------------------------------------------------------------

    @rule(who=PEOPLE, fate=FATES)
    def begin(self, who, fate):
        self._begin(self.browsers[who % len(self.browsers)], fate)

    @rule(who=PEOPLE, kind=KINDS, other=PEOPLE)
    def another_person_comes(self, who, kind, other):
        self.browsers[who % len(self.browsers)] = self._browser(kind, other)
        self._begin(self._of(who), HEARD)

    @rule(who=PEOPLE, count=st.integers(1, 6), fate=FATES)
    def answer_next(self, who, count, fate):
        browser = self._of(who)
        for left in reversed(range(count)):
            if browser.steps and not browser.refusals:
                self._put(browser, *self._next(browser), HEARD if left else fate)

    @rule(who=PEOPLE, left=st.integers(0, 2))
    def answer_all(self, who, left):
        browser = self._of(who)
        if browser.refusals:
            return
        for _ in range(len(browser.steps) - len(browser.saved) - left):
            self._put(browser, *self._next(browser), HEARD)
        self._finish(browser, COMPLETE, HEARD)
        self.past.append(browser)

    @rule(who=PEOPLE, which=st.integers(0, 20), same=st.booleans(), fate=FATES)
    def answer_again(self, who, which, same, fate):
        browser = self._of(who)
        if browser.outbox:
            seq = sorted(browser.outbox)[which % len(browser.outbox)]
            body = browser.outbox[seq] if same else self._new_body(browser, seq)
            self._put(browser, seq, body, fate)

    @rule(people=st.lists(PEOPLE, min_size=3, max_size=8), fate=FATES)
    def answer_at_the_same_time(self, people, fate):
        browsers = [self._of(who) for who in people if self._of(who).steps]
        answers = [(browser, *self._next(browser)) for browser in browsers]
        fate = HEARD if fate == AT_THE_ANSWER else fate
        heard = self._send([self._record(*one) for one in answers], fate)
        for (browser, seq, _), told in zip(answers, heard, strict=True):
            self._hear(browser, seq, told)

    @rule(who=PEOPLE, new_tab=st.booleans(), fate=FATES)
    def reload(self, who, new_tab, fate):
        browser = self._of(who)
        if new_tab:
            browser.tabs.append(f"{browser.tabs[0][:-1]}{len(browser.tabs) + 1}")
        if browser.token:
            told = self._post(browser, "resume", {"tab": browser.tab}, fate)
            if told is not None and told.status == 200:
                browser.saved = set(told.said["done"])

    @rule(who=PEOPLE)
    def look(self, who):
        if self._of(who).token:
            self._post(self._of(who), "resume", {}, HEARD)

    @rule(who=PEOPLE, tab=st.integers(0, 3), fate=FATES)
    def another_tab_answers(self, who, tab, fate):
        browser = self._of(who)
        if browser.steps:
            tabs = [*browser.tabs, f"{browser.tabs[0]}-never-claimed"]
            self._put(browser, *self._next(browser), fate, tabs[tab % len(tabs)])

    ENDS = st.sampled_from(["declined", "screened_out", "failed_check", COMPLETE])

    @precondition(lambda self: any(b.key for b in self.past))
    @rule(which=st.integers(0, 30), state=ENDS, fate=FATES)
    def who_has_left_leaves_again(self, which, state, fate):
        past = [browser for browser in self.past if browser.key]
        self._finish(past[-1 - which % len(past)], state, fate)

    @rule(who=PEOPLE, state=ENDS, fate=FATES)
    def leave(self, who, state, fate):
        self._finish(self._of(who), state, fate)

    @rule(who=PEOPLE, state=ENDS, fate=FATES, tab=st.integers(0, 3))
    def a_forgotten_tab_leaves(self, who, state, fate, tab):
        browser = self._of(who)
        self._finish(browser, state, fate, browser.tabs[tab % len(browser.tabs)])

    @rule(who=PEOPLE, kind=KINDS, other=PEOPLE, fate=FATES)
    def decline(self, who, kind, other, fate):
        browser = self._browser(kind, other)
        self.browsers[who % len(self.browsers)] = browser
        self._begin(browser, HEARD)
        self._finish(browser, "declined", fate)
        self.oracle.check_nothing_is_left()

    @rule(who=PEOPLE, fate=FATES)
    def complete(self, who, fate):
        self._finish(self._of(who), COMPLETE, fate)

    @precondition(lambda self: self.sent)
    @rule(which=st.integers(0, 1000), later=st.sampled_from([0.0, 0.0, GAP / 2, 5 * HOUR]))
    def an_old_request_comes_again(self, which, later):
        self.oracle.pass_time(later)
        self._send([self.sent[-1 - which % len(self.sent)]], HEARD)

    @rule(who=PEOPLE, token=st.sampled_from(["", "x" * 43, "cut"]))
    def a_strangers_token(self, who, token):
        browser = self._of(who)
        if browser.steps:
            wrong = browser.token[:-1] if token == "cut" else token
            request = self._record(browser, 0, self._new_body(browser, 0))
            self._send([Request(request.what, "PUT", request.path, request.content, wrong)], HEARD)

    @rule(who=PEOPLE, by_code=st.booleans(), death=DEATHS)
    def withdraw(self, who, by_code, death):
        kept = self.oracle.alive.get(self._of(who).key)
        if kept is None:
            return
        name = kept.code if by_code else next(iter(personal(kept.link)), kept.participant)
        done = self.world.withdraw(name, death)
        same = [k for k in self.oracle.alive.values() if k.participant == kept.participant]
        there = {one.key for one in self.world.storage.sessions()}
        for one in same if not by_code else [kept]:
            if done or one.key not in there:
                self.oracle.died(one)
        self.oracle.check_nothing_is_left()

    @rule(people=st.lists(PEOPLE, min_size=1, max_size=4), commit=st.integers(1, 3))
    def withdraw_while_answers_come(self, people, commit):
        browsers = [self._of(who) for who in people]
        kept = self.oracle.alive.get(browsers[0].key)
        if kept is None or browsers[0].refusals:
            return
        answers = [(browser, *self._next(browser)) for browser in browsers if browser.steps]
        self._withdrawn_meanwhile(kept, [self._record(*one) for one in answers], commit)

    def _withdrawn_meanwhile(self, kept, requests, commit):
        self.oracle.pass_time(1.0)
        self.sent += requests
        done = []
        answers = self.world.ask(
            requests,
            meanwhile=lambda: done.append(self.world.withdraw_now(kept.participant)),
            commit=commit,
        )
        theirs = [self.oracle.tokens.get(request.token) == kept.key for request in requests]
        for request, told, is_theirs in zip(requests, answers, theirs, strict=True):
            if is_theirs and done:
                # Before it or after it.
                assert told.status in (200, 401), told
            else:
                self.oracle.answered(request, told)
        if done:
            self.oracle.died(kept)
        self.oracle.check_nothing_is_left()

    @rule(running=st.booleans(), who=PEOPLE)
    def the_database_is_deleted(self, running, who):
        browser = self._of(who)
        if not running:
            self.world.stop()
        self.world.delete_database()
        requests = [self._record(browser, *self._next(browser))] if browser.steps else []
        if running:
            self.sent += requests
            answers = self.world.ask(requests)
            taken = [one for one in zip(requests, answers, strict=True) if one[1].status < 500]
            for request, told in taken:
                self.oracle.answered(request, told)
            self.world.stop()
        self.world.start()
        self.oracle.restored()
        if running:
            self.oracle.settle(requests)

    @rule(who=PEOPLE, death=DEATHS)
    def import_file(self, who, death):
        browser = self._of(who)
        kept = self.oracle.alive.get(browser.key)
        if kept is not None and browser.outbox:
            summary = self.world.import_file(self._downloaded(browser), death)
            self.oracle.imported(kept, browser.outbox, summary)

    @precondition(lambda self: self.oracle.dead)
    @rule(which=st.integers(0, 30))
    def import_file_of_who_is_gone(self, which):
        gone = [b for b in [*self.past, *self.browsers] if b.key in self.oracle.dead and b.outbox]
        if gone:
            path = self._downloaded(gone[which % len(gone)])
            assert self.world.import_file(path).left_out == 1 + len(gone[which % len(gone)].outbox)

    def _downloaded(self, browser):
        path = self.world.study.parent / "downloaded.jsonl"
        opening = {"format": "pourcast-records", "schema_version": 1, "session": browser.key}
        records = [
            {"session": browser.key, "seq": seq, "body": body}
            for seq, body in sorted(browser.outbox.items())
        ]
        path.write_text("".join(json.dumps(line) + "\n" for line in [opening, *records]))
        return path

    @rule(seconds=st.sampled_from([-30 * DAY, -DAY, -HOUR, 2 * HOUR, DAY, 30 * DAY]))
    def clock_jumps(self, seconds):
        self.world.clock.jump(seconds)

    @rule(seconds=st.sampled_from([60.0, GAP / 2, GAP - 60.0, GAP + 60.0, DAY]))
    def nobody_does_anything(self, seconds):
        self.oracle.pass_time(seconds)

    @rule(who=PEOPLE, pauses=st.lists(st.sampled_from([0.7, 1.5]), min_size=2, max_size=2))
    def somebody_takes_their_time(self, who, pauses):
        browser = self._of(who)
        for pause in pauses:
            for _ in range(3):
                if browser.steps and not browser.refusals:
                    self._put(browser, *self._next(browser), HEARD)
            self.oracle.pass_time(pause * GAP)
        # Whoever comes next may be given the place of who is away.
        self._begin(self._browser("preview", 0), HEARD)

    @rule()
    def kill(self):
        self.world.kill()
        self.oracle.check_nothing_is_left()

    @rule()
    def restart(self):
        self.world.stop()
        self.world.start()

    @invariant()
    def all_is_there(self):
        if self.browsers:
            self.tally["steps"] += 1
            self.oracle.check()
