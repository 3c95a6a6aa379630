"""Two hundred participants at once: every answer acknowledged, soon.

The load is bounded in number and time, and goes to this machine only. Run with `pytest -m slow`.
"""

import asyncio
import json
import time

import numpy as np
import pytest

from tests.experiment.conftest import fresh_database
from tests.experiment.make import EXP1, answer, small_study
from tests.experiment.server_process import ServerProcess

PEOPLE, SECONDS = 200, 60


class Client:
    """One participant's connection, kept open as browsers do."""

    def __init__(self, port, number):
        self.port, self.number = port, number

    async def connect(self):
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", self.port)

    async def ask(self, method, path, content, token=""):
        body = json.dumps(content).encode()
        head = (
            f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n"
            f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        )
        self.writer.write(head.encode() + body)
        answered = await self.reader.readuntil(b"\r\n\r\n")
        length = int(answered.lower().split(b"content-length:")[1].split(b"\r\n")[0])
        text = await self.reader.readexactly(length)
        return int(answered.split(b" ")[1]), json.loads(text)

    async def take_part(self, key, begin_at, times):
        loop = asyncio.get_running_loop()
        await self.connect()
        content = {"request": f"request-{self.number}", "tab": f"tab-{self.number:08}"}
        status, told = await self.ask("POST", "/api/sessions", content | {"link": {"lab": key}})
        assert status == 201
        for k in range(SECONDS):
            await asyncio.sleep(max(0.0, begin_at + k + self.number / PEOPLE - loop.time()))
            step = told["steps"][k]
            began = loop.time()
            status, said = await self.ask(
                "PUT", f"/api/session/records/{step['seq']}",
                {"tab": content["tab"], "body": answer(step["kind"], k / 100)}, told["token"],
            )  # fmt: skip
            times.append(loop.time() - began)
            assert (status, said["saved"]) == (200, "new")
        self.writer.close()
        await self.writer.wait_closed()


async def run_load(port, key):
    times = []
    # All come within some seconds, then answer once a second.
    begin_at = asyncio.get_running_loop().time() + 8.0
    await asyncio.gather(*(Client(port, k).take_part(key, begin_at, times) for k in range(PEOPLE)))
    return np.array(times)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_two_hundred_participants_a_trial_a_second_for_a_minute(tmp_path, request, kind):
    study = small_study(tmp_path, scenes=60, design=EXP1)
    if kind == "sqlite":
        _load(study)
        return
    with fresh_database(request.getfixturevalue("postgresql")) as url:
        _load(study, "--database", url)


def _load(study, *options):
    with ServerProcess(study, *options) as server:
        began = time.monotonic()
        times = asyncio.run(run_load(server.port, server.lab.rpartition("=")[2]))
        print(
            f"{len(times)} records in {time.monotonic() - began:.0f} s; p50, p99, most "
            f"{np.quantile(times, [0.5, 0.99, 1.0]) * 1000} ms"
        )
    assert len(times) == PEOPLE * SECONDS
    assert np.quantile(times, 0.99) < 0.25
