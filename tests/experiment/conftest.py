"""Databases of both kinds, and a small study's experiment behind its API."""

import shutil
import subprocess
import tempfile
import uuid
from contextlib import contextmanager
from pathlib import Path

import pytest
import sqlalchemy as sa
from starlette.testclient import TestClient

from pourcast.experiment.design.links import link_key
from pourcast.experiment.server.admin import admin_routes
from pourcast.experiment.server.app import create_app
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.storage import Storage
from tests.experiment.make import answer, small_study

SCRIPT = Path(__file__).parent / "postgres.sh"

HAS_POSTGRESQL = bool(shutil.which("initdb") or list(Path("/usr/lib/postgresql").glob("*/bin")))


@pytest.fixture(scope="session")
def postgresql():
    """URL of a PostgreSQL server that is started for these tests."""
    if not HAS_POSTGRESQL:
        pytest.skip("there is no PostgreSQL")
    # Short, as the path of a socket has to be.
    folder = Path(tempfile.mkdtemp(prefix="pc-pg-"))
    folder.chmod(0o755)
    subprocess.run([SCRIPT, "start", folder], check=True)
    yield f"postgresql://tester@/postgres?host={folder}"
    subprocess.run([SCRIPT, "stop", folder], check=True)
    shutil.rmtree(folder)


@contextmanager
def fresh_database(server):
    """A database of one test's own."""
    name = f"t{uuid.uuid4().hex}"
    engine = sa.create_engine(
        sa.make_url(server).set(drivername="postgresql+psycopg"), isolation_level="AUTOCOMMIT"
    )
    with engine.connect() as connection:
        connection.exec_driver_sql(f"CREATE DATABASE {name}")
    yield server.replace("/postgres?", f"/{name}?")
    with engine.connect() as connection:
        connection.exec_driver_sql(f"DROP DATABASE {name} WITH (FORCE)")
    engine.dispose()


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request, tmp_path):
    """URL of an empty database."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'responses.sqlite'}"
        return
    with fresh_database(request.getfixturevalue("postgresql")) as url:
        yield url


@pytest.fixture
def storage(database):
    opened = Storage(database)
    yield opened
    opened.close()


class Clock:
    """A clock that tests set."""

    def __init__(self, now=1_700_000_000.0):
        self.now = now

    def __call__(self):
        return self.now


class Api:
    """The API of an experiment, as the page uses it."""

    def __init__(self, client, experiment, clock):
        self.client, self.experiment, self.clock = client, experiment, clock
        self.storage = experiment.storage

    def begin(self, request="request-1", tab="tab-00000001", link=None):
        given = {"lab": link_key(self.storage.secret, "lab")} if link is None else link
        return self.client.post(
            "/api/sessions", json={"request": request, "tab": tab, "link": given}
        )

    def put(self, told, seq, body, tab="tab-00000001"):
        return self.client.put(
            f"/api/session/records/{seq}",
            json={"tab": tab, "body": body},
            headers={"Authorization": f"Bearer {told['token']}"},
        )

    def post(self, told, what, **content):
        content |= {"tab": content.get("tab", "tab-00000001")} if what == "finish" else {}
        return self.client.post(
            f"/api/session/{what}",
            json=content,
            headers={"Authorization": f"Bearer {told['token']}"},
        )

    def run(self, told, response=lambda seq: seq / 100):
        """Do all steps, and end."""
        for step in told["steps"]:
            said = self.put(told, step["seq"], answer(step["kind"], response(step["seq"])))
            assert said.status_code == 200
        return self.post(told, "finish", state="complete").json()


@contextmanager
def api_of(study, *, clock=None, **options):
    clock = clock or Clock()
    storage = Storage.of_study(study)
    experiment = LiveExperiment(study, storage, clock=clock, **options)
    app = create_app(experiment, extra=admin_routes(experiment))
    with TestClient(app, raise_server_exceptions=False) as client:
        yield Api(client, experiment, clock)
    experiment.close()


@pytest.fixture
def api(tmp_path):
    with api_of(small_study(tmp_path)) as opened:
        yield opened
