"""The real server in a process of its own, to be killed; and participants who only speak HTTP."""

import asyncio
import http.client
import json
import random
import re
import socket
import subprocess
import sys
import threading
import time

from tests.experiment.make import answer


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class ServerProcess:
    """`pourcast experiment serve`, started, killed and started again."""

    def __init__(self, study, *options, run=("-m", "pourcast"), log=None):
        self.port, self.log = free_port(), log
        self.command = [
            sys.executable, *run, "experiment", "serve", str(study),
            *options, "--sessions-per-address", "1000", "--port", str(self.port),
        ]  # fmt: skip
        self.start()

    def start(self):
        log = self.log.open("ab") if self.log else None
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=log, text=True)
        if log:
            log.close()
        self.said = ""
        for line in self.process.stdout:
            self.said += line
            if line.startswith("Ctrl-C"):
                return
        raise AssertionError(f"the server did not start: {self.said}")

    @property
    def lab(self):
        return re.search(r"^lab +(\S+)$", self.said, re.MULTILINE)[1]

    @property
    def admin(self):
        """Path of the admin page, with its token."""
        return re.search(r"^admin +http://[^/]+(\S+)$", self.said, re.MULTILINE)[1]

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def stop(self):
        self.process.terminate()
        self.process.wait(30)
        self.process.stdout.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.stop()


def answered(port, method, path, content, token, *, timeout):
    """What a server answers to a request on a connection of its own: the answer and its body."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=timeout)
    try:
        connection.request(
            method, path, json.dumps(content),
            {"Content-Type": "application/json", "Authorization": f"Bearer {token}"},
        )  # fmt: skip
        response = connection.getresponse()
        return response, response.read()
    finally:
        connection.close()


class Asker:
    """What a page asks of a server, once, and what it is told: status and content."""

    def __init__(self, server):
        self.port, self.key = server.port, server.lab.rpartition("=")[2]

    def ask(self, method, path, content, token=""):
        response, text = answered(self.port, method, path, content, token, timeout=20)
        is_json = response.headers.get_content_type() == "application/json"
        return response.status, json.loads(text) if is_json else text.decode()

    def begin(self, request, tab="tab-00000001", link=None):
        content = {"request": request, "tab": tab, "link": link or {"lab": self.key}}
        status, told = self.ask("POST", "/api/sessions", content)
        assert status == 201, told
        return told

    def put(self, told, seq, body, tab="tab-00000001"):
        content = {"tab": tab, "body": body}
        return self.ask("PUT", f"/api/session/records/{seq}", content, told["token"])

    def resume(self, told, tab="tab-00000001"):
        return self.ask("POST", "/api/session/resume", {"tab": tab}, told["token"])

    def finish(self, told, state, tab="tab-00000001"):
        content = {"state": state, "tab": tab}
        return self.ask("POST", "/api/session/finish", content, told["token"])


class Sturdy(threading.Thread):
    """A participant who speaks HTTP and tries again until each answer is acknowledged."""

    def __init__(self, port, lab, number, pause=0.0):
        super().__init__(daemon=True)
        self.port, self.key = port, lab.rpartition("=")[2]
        self.number, self.pause = number, pause
        self.random = random.Random(number)
        self.answers = {}
        self.participant = ""
        self.error = None

    def ask(self, method, path, content, token="", seconds=120.0):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            try:
                response, text = answered(self.port, method, path, content, token, timeout=5)
                if response.status < 500:
                    assert response.status < 300, (path, response.status, text)
                    return json.loads(text)
            except (OSError, http.client.HTTPException):
                pass
            time.sleep(0.05 + 0.1 * self.random.random())
        raise AssertionError(f"{path}: no answer in {seconds} s")

    def run(self):
        try:
            self.take_part()
        except BaseException as error:
            self.error = error

    def take_part(self):
        begin = {"request": f"request-{self.number}", "tab": f"tab-{self.number:08}",
                 "link": {"lab": self.key}}  # fmt: skip
        told = self.ask("POST", "/api/sessions", begin)
        self.participant = told["participant"]
        for step in told["steps"]:
            response = round(self.random.random(), 3)
            if step["kind"] == "judgment":
                self.answers[step["seq"]] = response
            body = {"tab": begin["tab"], "body": answer(step["kind"], response)}
            self.ask("PUT", f"/api/session/records/{step['seq']}", body, told["token"])
            time.sleep(self.pause)
        end = self.ask("POST", "/api/session/finish", {"state": "complete"}, told["token"])
        assert end["missing"] == []


class CuttingProxy:
    """Between participants and server: cuts a share of the posts half-way, or their answers."""

    def __init__(self, port, share, seed=0):
        self.target, self.share = port, share
        self.random = random.Random(seed)
        self.port = free_port()
        self.cuts = {"request": 0, "answer": 0}
        self.loop = asyncio.new_event_loop()
        started = threading.Event()
        self.thread = threading.Thread(target=self._run, args=(started,), daemon=True)
        self.thread.start()
        started.wait()

    def _run(self, started):
        asyncio.set_event_loop(self.loop)
        self.server = self.loop.run_until_complete(
            asyncio.start_server(self._connection, "127.0.0.1", self.port)
        )
        started.set()
        self.loop.run_forever()

    def close(self):
        async def end():
            self.server.close()
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            self.loop.stop()

        asyncio.run_coroutine_threadsafe(end(), self.loop)
        self.thread.join()
        self.loop.close()

    async def _connection(self, reader, writer):
        try:
            there = await asyncio.open_connection("127.0.0.1", self.target)
        except OSError:
            writer.close()
            return
        posts = asyncio.Event()  # whether this connection's last request was a post
        try:
            await asyncio.gather(
                self._pass(reader, there[1], "request", posts),
                self._pass(there[0], writer, "answer", posts),
            )
        finally:
            writer.close()
            there[1].close()

    async def _pass(self, reader, writer, what, posts):
        try:
            while chunk := await reader.read(65536):
                if what == "request":
                    (posts.set if chunk.startswith((b"PUT", b"POST")) else posts.clear)()
                if posts.is_set() and self.random.random() < self.share:
                    self.cuts[what] += 1
                    writer.write(chunk[: len(chunk) // 2])
                    await writer.drain()
                    break
                writer.write(chunk)
                await writer.drain()
        except OSError:
            pass
        finally:
            writer.close()
