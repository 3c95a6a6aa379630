"""The server's connections: the silent, the slow and the many keep nobody out; and its end."""

import asyncio
import contextlib
import http.client
import json
import resource
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from pourcast.experiment.server import connections
from pourcast.experiment.server.addresses import Proxies
from pourcast.experiment.server.process import web_server
from pourcast.experiment.storage.storage import Storage
from tests.experiment.make import EXP1, small_study
from tests.experiment.server_process import ServerProcess, Sturdy


async def echo(request: Request):
    return PlainTextResponse(await request.body())


async def long(_):
    return PlainTextResponse(b"x" * 10_000_000)


@pytest.fixture
def server():
    """The server with a plain application, in a thread."""

    async def slow(_):
        while not opened.should_exit:
            await asyncio.sleep(0.02)

    methods = ["GET", "POST"]
    app = Starlette(
        routes=[Route("/", echo, methods=methods), Route("/long", long), Route("/slow", slow)]
    )
    opened = web_server(app, Proxies(), 100)
    listener = socket.create_server(("127.0.0.1", 0), backlog=2048)
    opened.port = listener.getsockname()[1]
    thread = threading.Thread(target=opened.run, kwargs={"sockets": [listener]})
    thread.start()
    opened.thread = thread
    yield opened
    opened.should_exit = True
    thread.join(30)
    assert not thread.is_alive()


@pytest.fixture
def open_connection(server):
    with contextlib.ExitStack() as stack:
        yield lambda source="127.0.0.1": stack.enter_context(
            socket.create_connection(
                ("127.0.0.1", server.port), timeout=20, source_address=(source, 0)
            )
        )


def asks(connection, path="/"):
    """Whether a request is answered."""
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    with contextlib.suppress(ConnectionError):
        return b"200 OK" in connection.recv(65536)
    return False


def is_ended(connection):
    """Whether the other end closes it, within the connection's time-out."""
    with contextlib.suppress(ConnectionError):
        while connection.recv(65536):
            pass
    return True


@pytest.mark.parametrize(
    ("limit", "value", "sent"),
    [
        ("HEAD_SECONDS", 0.3, b""),
        ("HEAD_SECONDS", 0.3, b"GET / HT"),
        ("HEAD_SECONDS", 0.3, b"GET / HTTP/1.1\r\nHost: x\r\n\r\nGET / HT"),
        ("BODY_SECONDS", 0.3, b"POST / HTTP/1.1\r\nContent-Length: 10\r\n\r\n{"),
        ("BODY_SECONDS", 0.3, b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n1\r\n{\r\n"),
        ("LARGEST_HEAD", 1000, b"GET / HTTP/1.1\r\nX: " + b"x" * 2000),
    ],
)
def test_who_keeps_the_server_waiting_is_cut_off(
    server, open_connection, monkeypatch, limit, value, sent
):
    monkeypatch.setattr(connections, limit, value)
    connection = open_connection()
    connection.sendall(sent)
    assert is_ended(connection)


def test_an_empty_line_between_two_requests_does_not_keep_a_connection(
    server, open_connection, monkeypatch
):
    monkeypatch.setattr(connections, "HEAD_SECONDS", 0.3)
    connection = open_connection()
    assert asks(connection)
    connection.sendall(b"\r\n")
    assert is_ended(connection)


def test_what_follows_a_body_is_limited_too(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "LARGEST_HEAD", 1000)
    connection = open_connection()
    connection.sendall(b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n1\r\n{\r\n0\r\n")
    time.sleep(0.1)
    connection.sendall(b"X: " + b"x" * 2000)
    assert is_ended(connection)


@pytest.mark.parametrize(
    "head", [b"GET / HTTP/1.1\r\nX: ", b"POST / HTTP/1.1\r\nContent-Length: 9999\r\n\r\n"]
)
def test_a_byte_now_and_then_does_not_keep_a_connection(server, open_connection, monkeypatch, head):
    monkeypatch.setattr(connections, "HEAD_SECONDS", 0.5)
    monkeypatch.setattr(connections, "BODY_SECONDS", 0.5)
    connection = open_connection()
    connection.sendall(head)
    with pytest.raises(ConnectionError):
        for _ in range(200):
            connection.sendall(b"x")
            time.sleep(0.05)


def test_who_never_reads_the_answer_is_cut_off(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "READING_SECONDS", 0.3)
    connection = open_connection()
    connection.sendall(b"GET /long HTTP/1.1\r\nHost: x\r\n\r\n")
    wait_until(lambda: server.server_state.connections)
    wait_until(lambda: not server.server_state.connections)
    assert not server.server_state.tasks


def test_who_reads_slowly_is_waited_for(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "READING_SECONDS", 1.0)
    connection = open_connection()
    connection.sendall(b"GET /long HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
    count = 0
    while chunk := connection.recv(200_000):
        count += len(chunk)
        time.sleep(0.03)
    assert count > 10_000_000


def test_between_two_requests_a_connection_is_kept(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "HEAD_SECONDS", 0.2)
    connection = open_connection()
    for _ in range(3):
        assert asks(connection)
        time.sleep(0.4)
    assert asks(connection)


def test_the_silent_make_room_and_those_in_use_stay(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "most_connections", lambda: 40)
    used = open_connection()
    assert asks(used)
    silent = [open_connection() for _ in range(60)]
    new = open_connection()
    assert asks(new)
    assert asks(used)
    assert len(server.server_state.connections) <= 20  # half of them: all are of one address
    # Those who came last are there still.
    assert asks(silent[-1])
    assert is_ended(silent[0])


def test_those_in_use_make_room_when_no_silent_ones_are_left(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "most_connections", lambda: 40)
    used = [open_connection() for _ in range(20)]
    assert all(map(asks, used))
    assert asks(used[0])  # not the longest silent any more
    assert asks(open_connection())
    assert asks(used[0])
    assert is_ended(used[1])


def test_who_is_being_answered_makes_room_for_nobody(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "most_connections", lambda: 8)
    monkeypatch.setattr(connections, "ENDING_SECONDS", 0.2)
    for _ in range(4):
        open_connection().sendall(b"GET /slow HTTP/1.1\r\nHost: x\r\n\r\n")
    wait_until(lambda: len(server.server_state.tasks) == 4)
    assert is_ended(open_connection())
    assert len(server.server_state.tasks) == 4


def test_of_a_full_house_the_address_that_has_most_makes_room(server, open_connection, monkeypatch):
    monkeypatch.setattr(connections, "most_connections", lambda: 20)
    # Ten of one address are allowed: three addresses fill it.
    others = [open_connection(f"127.0.0.{k}") for k in (2, 3) for _ in range(6)]
    many = [open_connection() for _ in range(10)]
    assert asks(open_connection())
    assert is_ended(many[0])
    assert all(map(asks, others))


def wait_until(condition):
    until = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_files_are_as_many_as_the_system_allows_and_connections_fewer():
    code = (
        "import resource; from pourcast.experiment.server import connections as c;"
        "c.raise_file_limit(); print(resource.getrlimit(resource.RLIMIT_NOFILE)[0], c.most_connections())"
    )
    for files in (256, 1024):
        done = subprocess.run(
            ["bash", "-c", f"ulimit -Sn 128; ulimit -Hn {files}; exec {sys.executable} -c '{code}'"],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        limit, most = map(int, done.stdout.split())
        assert limit == files
        assert 0 < most < files - connections._OTHER_FILES


# The real server, in a process of its own ------------------------------------------------


class FewFiles(ServerProcess):
    """The server, with as few files as a test likes, and what it complains of."""

    def __init__(self, study, files=None):
        self.files = files
        super().__init__(study)

    def start(self):
        command = self.command
        if self.files:
            command = ["bash", "-c", f'ulimit -n {self.files}; exec "$@"', "bash", *command]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.said = ""
        for line in self.process.stdout:
            self.said += line
            if line.startswith("Ctrl-C"):
                return
        raise AssertionError(f"the server did not start: {self.said}{self.process.stderr.read()}")

    def end(self, *signals):
        """End it by signals; exit code, what it said since the start, and complaints."""
        for one in signals:
            self.process.send_signal(one)
            time.sleep(0.02)
        out, complaints = self.process.communicate(timeout=30)
        return self.process.returncode, out, complaints


class Impatient(Sturdy):
    """A participant who tries nothing twice."""

    def ask(self, method, path, content, token="", seconds=20.0):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=seconds)
        headers = {"Authorization": f"Bearer {token}"}
        connection.request(method, path, json.dumps(content), headers)
        response = connection.getresponse()
        text = response.read()
        connection.close()
        assert response.status < 300, text
        return json.loads(text)


@contextlib.contextmanager
def many_files():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.slow
@pytest.mark.parametrize("sent", [
    b"", b"GET / HTTP/1.1\r\nX: ", b"POST /api/sessions HTTP/1.1\r\nContent-Length: 99\r\n\r\n{",
])  # fmt: skip
def test_eleven_hundred_silent_connections_keep_no_participant_out(tmp_path, sent):
    study = small_study(tmp_path, design=EXP1)
    with many_files(), FewFiles(study, 1024) as server, contextlib.ExitStack() as silent:
        for _ in range(1100):
            one = socket.create_connection(("127.0.0.1", server.port), timeout=20)
            silent.enter_context(one).sendall(sent)
        Impatient(server.port, server.lab, 1).take_part()
        code, out, complaints = server.end(signal.SIGTERM)
    assert (code, complaints) == (0, "")
    assert "stopped; 14 records are saved" in out


@pytest.mark.slow
def test_a_storm_of_connections_keeps_no_participant_out(tmp_path):
    study = small_study(tmp_path, design=EXP1)
    over = threading.Event()

    async def storm(port):
        """Six hundred at any time, closed and opened again at once, with and without a word."""

        async def one(number):
            while not over.is_set():
                with contextlib.suppress(OSError):
                    reader, writer = await asyncio.open_connection("127.0.0.1", port)
                    writer.write([b"", b"GET / HTTP/1.1\r\nX: "][number % 2])
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(reader.read(), 0.5)
                    writer.close()
                await asyncio.sleep(0.02)

        await asyncio.gather(*map(one, range(600)))

    with many_files(), FewFiles(study, 256) as server:
        stormer = threading.Thread(target=lambda: asyncio.run(storm(server.port)))
        stormer.start()
        time.sleep(1.0)
        people = [Sturdy(server.port, server.lab, k) for k in range(3)]
        for person in people:
            person.start()
        for person in people:
            person.join(120)
            assert person.error is None
        over.set()
        stormer.join(60)
        assert server.end(signal.SIGTERM)[::2] == (0, "")


SIGNALS = [[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT] * 5]


@pytest.mark.parametrize(
    "signals", [[signal.SIGINT] * 2, *(pytest.param(s, marks=pytest.mark.slow) for s in SIGNALS)]
)
def test_it_ends_in_the_middle_of_everything_without_a_word_too_much(tmp_path, signals):
    study = small_study(tmp_path, design=EXP1)
    put = b"PUT /api/session/records/1 HTTP/1.1\r\nContent-Length: 9\r\n\r\n{"
    with FewFiles(study) as server, contextlib.ExitStack() as stack:
        for sent in (b"", b"GET / HT", put):
            one = socket.create_connection(("127.0.0.1", server.port), timeout=20)
            stack.enter_context(one).sendall(sent)
        people = [Sturdy(server.port, server.lab, k) for k in range(8)]
        for person in people:
            person.start()
        wait_until(lambda: any(person.answers for person in people))
        code, out, complaints = server.end(*signals)
        assert complaints == ""
        assert code == 0
        storage = Storage.of_study(study)
        assert f"stopped; {len(storage.records())} records are saved" in out
        storage.close()
        # Started again, everybody goes on, and nothing is lost.
        server.start()
        for person in people:
            person.join(60)
            assert person.error is None
        storage = Storage.of_study(study)
        assert len(storage.records()) == 8 * 14
        storage.close()
        assert server.end(signal.SIGTERM)[::2] == (0, "")
