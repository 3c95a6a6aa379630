"""Ctrl-C ends a command within a second, in one line, whatever it is at."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

import pytest

from pourcast.observers.observers import Observers
from pourcast.observers.responses import rehearse
from pourcast.scenes.scene_file import write_scenes
from pourcast.tables import write_table
from tests.comparison.make import made_up_table, voronoi_scenes

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no terminals here")

BUSY = """
import hashlib, signal, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from pourcast.cli import app, main
from pourcast.cli.terminal import resumable

@app.command()
def busy():
    with resumable(Path("HERE")):
        {work}

sys.argv = ["pourcast", "busy"]
main()
"""

AT_IT = "print('at it', file=sys.stderr, flush=True)"

WAITING = f"with ThreadPoolExecutor() as pool: pool.submit(time.sleep, 100); {AT_IT}"
"""The main thread knows, and waits for one that doesn't end."""

COMPUTING = (
    f"threading.Timer(0.5, lambda: {AT_IT}).start(); hashlib.pbkdf2_hmac('sha512', b'', b'', 10**9)"
)
"""The main thread doesn't know: it is where Python's own code doesn't run."""

OWN_TIME = f"""
        got = []
        signal.signal(signal.SIGINT, lambda *_: got.append(1))
        {AT_IT}
        while not got:
            time.sleep(0.01)
        time.sleep(1.0)
        sys.stderr.write("ended well")
"""


@pytest.fixture(autouse=True)
def not_ignored():
    """What a shell starts in the background ignores Ctrl-C, and hands that on to its children."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


LONGEST = 120.0
"""Seconds in which a command must have shown where it is."""


@contextmanager
def killed_after(seconds, process):
    timer = threading.Timer(seconds, os.killpg, (process.pid, signal.SIGKILL))
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class Interrupted:
    """A process on a terminal that got Ctrl-C once it had shown some words.

    One that never shows them, as they are others now, is killed: what is interrupted here would
    go on for days.
    """

    def __init__(self, command, words, signals=1):
        ours, its = os.openpty()
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=its, start_new_session=True,
            env={**os.environ, "COLUMNS": "150", "TERM": "xterm", "NUMBA_DISABLE_JIT": "0"},
        )  # fmt: skip
        os.close(its)
        self.shown = ""
        with killed_after(LONGEST, process), open(ours, "rb", buffering=0) as terminal:
            while not re.search(words, self.shown):
                self._take(terminal)
            begin = time.monotonic()
            for _ in range(signals):
                os.killpg(process.pid, signal.SIGINT)  # as a terminal does: all of them
                time.sleep(0.02)
            with suppress(OSError):  # the other end is closed
                while True:
                    self._take(terminal)
        self.code = process.wait()
        self.seconds = time.monotonic() - begin
        print(f"{self.seconds:.2f} s")

    def _take(self, terminal):
        part = terminal.read(4096)
        if not part:
            raise OSError
        self.shown += part.decode(errors="replace")


def within_a_second(command, words, **options):
    """Interrupt it; a busy machine is known by how long the least of all Pythons takes to end."""
    least = [sys.executable, "-c", "import sys, time; sys.stderr.write('.'); time.sleep(100)"]
    slowness = Interrupted(least, r"\.").seconds
    found = Interrupted(command, words, **options)
    assert found.code == 130, found.shown
    assert found.seconds < 1.0 + 10 * slowness
    assert "Traceback" not in found.shown
    lines = re.findall(r"pourcast: .*", found.shown)
    assert len(lines) == 1, found.shown
    # The cursor, which a bar hides, is there again.
    assert found.shown.rfind("\x1b[?25h") >= found.shown.rfind("\x1b[?25l")
    return lines[0].strip()


@pytest.mark.parametrize("signals", [1, 2])
@pytest.mark.parametrize(
    "work", [pytest.param(WAITING, id="waiting"), pytest.param(COMPUTING, id="computing")]
)
def test_a_process_ends_whatever_its_main_thread_is_at(work, signals):
    command = [sys.executable, "-c", BUSY.format(work=work)]
    said = within_a_second(command, "at it", signals=signals)
    assert said.startswith("pourcast: interrupted: what is done lies in HERE; the same command")


def test_who_has_a_handler_of_their_own_ends_in_their_own_time():
    found = Interrupted([sys.executable, "-c", BUSY.format(work=OWN_TIME)], "at it")
    assert found.code == 0
    assert found.shown.endswith("ended well")


def pourcast(*arguments):
    return [sys.executable, "-m", "pourcast", *map(str, arguments)]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    scenes = voronoi_scenes(10)
    write_scenes(folder / "scenes.json", scenes)
    write_table(folder / "judgments" / "grid.parquet", made_up_table(scenes))
    who = Observers(
        12, {"water": "water-simple", "honey": "gravity"}, (("water",), ("honey",)), spreads={}
    )
    rehearse(folder, scenes, who)
    return folder


def test_prediction(study):
    command = pourcast("predict", study / "scenes.json", "-m", "ife:n_particles=400")
    assert within_a_second(command, r"of 90.*, \d+ s ") == "pourcast: interrupted"


@pytest.mark.slow
def test_prediction_while_kernels_are_compiled(study, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    command = pourcast("predict", study / "scenes.json", "-m", "ife:n_particles=400")
    assert within_a_second(command, r"of 90 \(compiling.*, \d+ s so far") == "pourcast: interrupted"


@pytest.mark.slow
def test_sweeps(study):
    command = pourcast("sweep", study, "--grid", "paper-exp1")
    said = within_a_second(command, r"0 of \d+ simulations, ")
    assert said.endswith("shards are done; the same command goes on from there")


SLOW_TO_START = """
import sys, time
if "--multiprocessing-fork" in sys.orig_argv:
    print("a worker starts", file=sys.stderr, flush=True)
    time.sleep(2)
"""


def test_sweeps_whose_workers_are_just_starting(study, monkeypatch, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(SLOW_TO_START)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    command = pourcast("sweep", study, "--grid", "paper-exp1")
    said = within_a_second(command, "a worker starts")
    assert said.endswith("shards are done; the same command goes on from there")


@pytest.mark.slow
def test_comparison(study):
    # What takes its time is what no sweep has judged yet.
    specs = [f"ife:n_particles=200,damping_zeta={zeta}" for zeta in range(17)]
    command = pourcast("compare", study, *(part for spec in specs for part in ("-m", spec)))
    assert within_a_second(command, "judging: ").startswith("pourcast: interrupted")


@pytest.mark.slow
def test_recovery(study):
    command = pourcast(
        "recover", "models", study, "-m", "gravity", "-m", "simple", "--studies", 10**6
    )
    assert within_a_second(command, "planting ") == "pourcast: interrupted"


@pytest.mark.slow
def test_stimuli(study):
    # One film, made in the process itself.
    options = ("--scenes", 1, "--liquid", "honey", "--resolution", 150)
    said = within_a_second(pourcast("stimuli", study, *options), r"pictures: [1-9]\d* of ")
    assert said.endswith("the same command goes on from there")


@pytest.mark.slow
def test_learning(tmp_path):
    pytest.importorskip("torch")
    command = pourcast(
        "convnet", "train", "-e", "exp1", "-n", 40, "--tuned-scenes", 0, "--no-filter",
        "--passes", 10_000, "-o", tmp_path / "net",
    )  # fmt: skip
    said = within_a_second(command, r"learning water: stage \d of")
    assert said.endswith("the same command goes on from there")
