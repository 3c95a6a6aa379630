"""Participants who walk through a real server at the same time, while it is killed again and again.

Each remembers what they were told is saved; what nobody told them of may be saved or not.
"""

import http.client
import json
import random
import threading
import time
from dataclasses import dataclass, field

from tests.experiment.make import answer

LONGEST_WAIT = 300.0
"""After so long without any answer something is wrong, and no matter of a slow machine [s]."""


@dataclass
class Visit:
    """A session, as the participant knows it.

    `told` are the bodies said to be saved, by step; `sent` all that was ever sent; `aside` those
    said to be kept beside another.
    """

    request: str
    key: str = ""
    token: str = ""
    steps: list = field(default_factory=list)
    told: dict = field(default_factory=dict)
    sent: dict = field(default_factory=dict)
    aside: dict = field(default_factory=dict)
    end: str = "open"
    code: str = ""


class Meter:
    """Counts requests, and says when so many were sent."""

    def __init__(self):
        self.count = 0
        self._changed = threading.Condition()

    def add(self):
        """Count one."""
        with self._changed:
            self.count += 1
            self._changed.notify_all()

    def wait_for(self, count, alive):
        """Wait until so many were sent, or nobody sends any more."""
        with self._changed:
            while self.count < count and alive():
                self._changed.wait(0.5)


class Wanderer(threading.Thread):
    """Somebody who comes again and again, and does all that a browser may do."""

    def __init__(self, port, link, number, requests, meter):
        super().__init__(daemon=True)
        self.port, self.link, self.number = port, link, number
        self.requests, self.meter = requests, meter
        self.random = random.Random(number)
        self.visits = []
        self.old = []
        self.answers = 0
        self.error = None

    # Requests ------------------------------------------------------------------------

    def send(self, method, path, content, token="", *, lose=False):
        """Status and content of the answer; None if nothing was heard, or nobody listened."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.connect()
            self.requests -= 1
            self.meter.add()
            connection.request(
                method, path, json.dumps(content),
                {"Content-Type": "application/json", "Authorization": f"Bearer {token}"},
            )  # fmt: skip
            if lose:
                return None
            response = connection.getresponse()
            text = response.read()
        except (OSError, http.client.HTTPException):
            time.sleep(0.05 + 0.1 * self.random.random())
            return None
        finally:
            connection.close()
        assert response.status < 500 or response.status == 503, (path, response.status, text)
        return None if response.status == 503 else (response.status, json.loads(text))

    def ask(self, method, path, content, token=""):
        """Ask until there is an answer, as the page does; some answers get lost."""
        self.old.append((method, path, content, token))
        until = time.monotonic() + LONGEST_WAIT
        while time.monotonic() < until:
            said = self.send(method, path, content, token, lose=self.random.random() < 0.1)
            if said is not None:
                return said
        raise AssertionError(f"{path}: no answer in {LONGEST_WAIT} s")

    def put(self, visit, seq, body, tab):
        """Post a record until it is acknowledged."""
        visit.sent.setdefault(seq, []).append(body)
        path, content = f"/api/session/records/{seq}", {"tab": tab, "body": body}
        return self.ask("PUT", path, content, visit.token)

    # Visits --------------------------------------------------------------------------

    def run(self):
        """Come until so many requests were sent."""
        try:
            while self.requests > 0:
                self.visit()
        except BaseException as error:
            self.error = error

    def visit(self):
        """A whole session."""
        name = f"{self.number:02}-{len(self.visits):04}"
        visit, tab = Visit(f"request-{name}"), f"tab-{name}-1"
        self.visits.append(visit)
        link = self.link or {"PROLIFIC_PID": f"pid-of-{name}-person", "SESSION_ID": name}
        begin = {"request": visit.request, "tab": tab, "link": link}
        status, told = self.ask("POST", "/api/sessions", begin)
        assert (status, told["done"], told["state"]) == (201, [], "open")
        visit.key, visit.token = told["key"], told["token"]
        visit.steps, visit.code = told["steps"], told["code"]
        if self.random.random() < 0.2:
            self.decline(visit, tab)
            return
        for step in visit.steps:
            if self.requests <= 0:
                return  # away for good
            self.answer(visit, step, tab)
            tab = self.reload(visit, tab)
            self.repeat_something_old()
        self.complete(visit, tab)

    def decline(self, visit, tab):
        """Decline before consent; nothing can be said to that session any more."""
        content = {"state": "declined", "tab": tab}
        status, _ = self.ask("POST", "/api/session/finish", content, visit.token)
        assert status == 200
        visit.end = "declined"
        assert self.put(visit, 0, answer("consent"), tab)[0] == 401

    def answer(self, visit, step, tab):
        """Answer a step, perhaps twice, or differently the second time."""
        seq = step["seq"]
        body = self.body(step["kind"])
        status, said = self.put(visit, seq, body, tab)
        assert status == 200
        assert said["saved"] in ("new", "repeated")
        visit.told[seq] = body
        chance = self.random.random()
        if chance < 0.1:
            assert self.put(visit, seq, body, f"{tab}-other")[1]["saved"] == "repeated"
        elif chance < 0.2:
            other = self.body(step["kind"])
            assert self.put(visit, seq, other, tab)[1]["saved"] == "conflict"
            visit.aside.setdefault(seq, []).append(other)

    def reload(self, visit, tab):
        """Perhaps load the page again; the tab that has the session then."""
        if self.random.random() > 0.1:
            return tab
        tab = f"{tab[:-1]}{int(tab[-1]) % 9 + 1}"
        status, told = self.ask("POST", "/api/session/resume", {"tab": tab}, visit.token)
        assert status == 200
        assert (told["key"], told["steps"]) == (visit.key, visit.steps)
        assert told["done"] == sorted(visit.told)
        return tab

    def repeat_something_old(self):
        """Perhaps something comes a second time that was sent long ago; nobody waits for it."""
        if self.random.random() < 0.1:
            method, path, content, token = self.random.choice(self.old)
            if token not in ("", self.visits[-1].token):
                self.send(method, path, content, token)

    def complete(self, visit, tab):
        """End it; a forgotten tab undoes nothing."""
        content = {"state": "complete", "tab": tab}
        status, said = self.ask("POST", "/api/session/finish", content, visit.token)
        assert (status, said["missing"]) == (200, [])
        visit.end = "complete"
        for state in ("declined", "screened_out"):
            content = {"state": state, "tab": self.random.choice([tab, "tab-forgotten"])}
            assert self.ask("POST", "/api/session/finish", content, visit.token)[0] == 200

    def body(self, kind):
        """An answer that nobody else gives, nor anybody again."""
        self.answers += 1
        time_of_answer = self.number + self.answers / 100_000
        return answer(kind, self.random.randrange(1000) / 1000) | {"rt": time_of_answer}
