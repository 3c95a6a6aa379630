"""`pourcast experiment serve` and its kin at the command line."""

import re
import signal
import socket
from contextlib import closing

import pytest
from starlette.testclient import TestClient

from pourcast import cli
from pourcast.errors import InputError, StoreError
from pourcast.experiment.page import pages
from pourcast.experiment.server.process import Address, ExperimentServer, lock_study
from pourcast.experiment.storage.storage import Storage
from tests.experiment.make import small_study
from tests.experiment.server_process import ServerProcess, Sturdy


def call(*arguments):
    return cli.run(["experiment", *map(str, arguments)])


def test_serving_prints_the_links_and_ends_with_what_is_saved(tmp_path):
    study = small_study(tmp_path)
    with ServerProcess(study) as server:
        for word in ("lab ", "prolific ", "preview ", "admin ", "experiment.toml"):
            assert word in server.said
        assert "PROLIFIC_PID={{%PROLIFIC_PID%}}" in server.said
        someone = Sturdy(server.port, server.lab, 1)
        someone.take_part()
        server.process.send_signal(2)
        server.process.wait(30)
        rest = server.process.stdout.read()
        server.process.stdout.close()
    assert "stopped; 14 records are saved" in rest
    assert server.process.returncode == 0


def test_a_check_makes_the_stimuli_and_the_design_and_stops(tmp_path, capsys):
    study = small_study(tmp_path)
    (study / "experiment.toml").unlink()
    (study / "practice.json").unlink()
    assert call("serve", study, "--check") == 0
    said = capsys.readouterr().out
    assert "6 scenes, 0 practice trials, groups: water | honey" in said
    assert "Prolific: study link http://127.0.0.1:8000/?PROLIFIC_PID={{%PROLIFIC_PID%}}&" in said
    assert "Prolific: no code for who completes" in said
    assert (study / "experiment.toml").is_file()


def test_a_study_is_served_once(tmp_path, capsys):
    study = small_study(tmp_path)
    lock = lock_study(study)
    assert call("serve", study, "--check") == 1
    assert "is being served already" in capsys.readouterr().err
    lock.release()
    assert call("serve", study, "--check") == 0


def test_a_port_that_is_taken_is_told_of(tmp_path, capsys):
    study = small_study(tmp_path)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert call("serve", study, "--port", port) == 1
    assert f"127.0.0.1:{port}: Address already in use; choose another with --port" in (
        capsys.readouterr().err
    )


def test_a_page_that_was_not_built_says_how(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(pages, "DIST", tmp_path / "nothing")
    assert call("serve", small_study(tmp_path / "s"), "--check") == 2
    said = capsys.readouterr().err
    assert "has not been built; install Node.js 20 or newer and run: npm" in said


@pytest.mark.parametrize(
    ("address", "public", "base"),
    [
        (Address(), False, "http://127.0.0.1:8000"),
        (Address("::1"), False, "http://[::1]:8000"),
        (Address("0.0.0.0"), True, f"http://{socket.gethostname()}:8000"),
        (Address(public_url="https://lab.example.org/pour/"), True, "https://lab.example.org/pour"),
    ],
)
def test_links_begin_with_what_participants_can_reach(address, public, base):
    assert address.is_public is public
    assert address.base(8000) == base


def test_a_study_that_is_none_is_told_of(tmp_path, capsys):
    assert call("serve", tmp_path / "nothing") == 2
    assert "expected a study folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("address", "admin", "has_admin"),
    [
        (Address(), None, True),
        (Address("0.0.0.0"), None, False),
        (Address("0.0.0.0"), True, True),
        (Address(), False, False),
    ],
)
def test_the_admin_page_is_for_this_machine_unless_it_is_said_otherwise(
    tmp_path, address, admin, has_admin
):
    study = small_study(tmp_path)
    with closing(ExperimentServer(study, Storage.of_study(study), address, admin=admin)) as server:
        links = server.links("http://here")
        assert list(links) == ["lab", "prolific", "preview", *(["admin"] if has_admin else [])]
        assert all(link.startswith("http://here/") for link in links.values())
        client = TestClient(server.app)
        token = server.experiment.storage.admin_token
        assert client.get(f"/admin?token={token}").status_code == (200 if has_admin else 404)


def test_a_server_has_its_study_to_itself_until_it_is_closed(tmp_path):
    study = small_study(tmp_path)

    def open_server():
        return closing(ExperimentServer(study, Storage.of_study(study), Address()))

    with open_server(), pytest.raises(StoreError, match="is being served already"):
        open_server()
    with open_server():
        pass


def test_a_server_that_cannot_be_made_ready_leaves_the_study_to_others(tmp_path, monkeypatch):
    study = small_study(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(pages, "DIST", tmp_path / "nothing")
        with pytest.raises(InputError, match="has not been built"):
            ExperimentServer(study, Storage.of_study(study), Address())
    lock_study(study).release()


def test_a_server_says_its_links_before_anybody_can_come_and_ends_by_ctrl_c(tmp_path, monkeypatch):
    ended = []

    def interrupted(server, sockets):
        signal.raise_signal(signal.SIGINT)
        ended.append(server.should_exit)

    monkeypatch.setattr("uvicorn.Server.run", interrupted)
    # Whatever another test's library has put there.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    study = small_study(tmp_path)
    said = {}
    with closing(ExperimentServer(study, Storage.of_study(study), Address(port=0))) as server:
        server.run(said.update)
    assert ended == [True]
    # Ctrl-C is again what it was before.
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler
    assert re.match(r"http://127.0.0.1:\d+/\?lab=", said["lab"])
