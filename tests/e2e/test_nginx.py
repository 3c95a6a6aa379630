"""A real nginx before the experiment, at a path of its own, set up as the documentation says.

Needs nginx and Chromium (Debian: `apt-get install nginx chromium`), and is skipped without.
"""

import os
import re
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest

from pourcast.observers.browser import chromium
from tests.e2e.participant import Participant
from tests.e2e.test_experiment_faults import check
from tests.experiment.make import EXP1, small_study
from tests.experiment.server_process import ServerProcess, free_port

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "run-an-experiment.md"
NGINX = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(NGINX is None, reason="there is no nginx"),
    pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no Chromium"),
]

# What a Debian server has around the block, and headers that an administrator gives all pages.
AROUND = """
daemon off;
pid {folder}/nginx.pid;
error_log {folder}/error.log;
{user}
events {{ worker_connections 768; }}
http {{
    include /etc/nginx/mime.types;
    default_type application/octet-stream;
    sendfile on;
    tcp_nopush on;
    gzip on;
    gzip_types text/css application/javascript text/javascript application/json;
    access_log {folder}/access.log;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    add_header X-Frame-Options SAMEORIGIN always;
    add_header X-Content-Type-Options nosniff always;
    add_header Content-Security-Policy "default-src 'self'" always;
    server {{
        listen 127.0.0.1:{port};
        server_name localhost;
        {block}
    }}
}}
"""


@contextmanager
def nginx(folder, port, block):
    """nginx with the documentation's block in its `server`."""
    folder.mkdir()
    user = "user root;" if os.geteuid() == 0 else ""  # the test's folder is the tester's alone
    setup = folder / "nginx.conf"
    setup.write_text(AROUND.format(folder=folder, port=port, block=block, user=user))
    process = subprocess.Popen([NGINX, "-c", setup, "-e", folder / "error.log"])
    try:
        until = time.monotonic() + 30
        while not (folder / "nginx.pid").exists():
            assert process.poll() is None, (folder / "error.log").read_text()
            assert time.monotonic() < until
            time.sleep(0.02)
        yield
    finally:
        process.terminate()
        process.wait(30)


def block_of_the_page(port):
    (block,) = re.findall(r"^```nginx\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert "127.0.0.1:8000" in block
    return block.replace("127.0.0.1:8000", f"127.0.0.1:{port}")


@pytest.fixture
def site(tmp_path):
    """A server behind nginx: the server, and the URL that participants know."""
    port = free_port()
    public = f"http://localhost:{port}/pour"
    study = small_study(tmp_path / "s", scenes=12, design=EXP1 + "blocks = 1\n")
    options = ("--public-url", public, "--behind-proxy", "--admin")
    with ServerProcess(study, *options) as server:
        server.study = study
        with nginx(tmp_path / "nginx", port, block_of_the_page(server.port)):
            yield server, public


def link_of(server, name):
    return re.search(rf"^{name} +(\S+)$", server.said, re.MULTILINE)[1]


def test_a_session_through_nginx_from_consent_to_the_end_with_a_restart_in_between(site):
    server, public = site
    with chromium() as browser:
        assert link_of(server, "lab").startswith(f"{public}/?lab=")
        # Without the last slash, as people write links.
        someone = Participant(browser, link_of(server, "lab").replace("/pour/?", "/pour?"))
        someone.begin()
        someone.go_on(stop_at=3)
        someone.page.wait_for_timeout(1000)  # the block's pictures are there
        server.stop()
        someone.go_on(stop_at=7)
        server.start()
        seen = someone.go_on()
        assert seen[-1] == "debrief"
        assert someone.context.cookies() == []
        someone.check(allow=["502", "Failed to load resource"])
        assert all(url.startswith((public, "blob:")) for url in someone.asked)
        someone.close()

        researcher = Participant(browser, link_of(server, "admin"))
        researcher.see("Responses by scene")
        assert "13 judgments saved" in researcher.page.inner_text("body")
        style = researcher.page.eval_on_selector("body", "b => getComputedStyle(b).fontFamily")
        assert style != researcher.page.evaluate(
            "() => getComputedStyle(document.createElement('p')).fontFamily"
        )
        with researcher.page.expect_download() as download:
            researcher.page.get_by_role("link", name="trials").click()
        assert len(Path(download.value.path()).read_text().splitlines()) == 14
        researcher.check()
        researcher.close()
    assert check(server.study, browsers=[someone]) == 13


def test_headers_are_the_experiments_and_pages_are_packed(site):
    server, public = site
    asked = urllib.request.Request(link_of(server, "lab"), headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(asked) as answer:
        headers = answer.headers
    assert headers["Content-Encoding"] == "gzip"
    assert [value[:20] for value in headers.get_all("Content-Security-Policy")] == [
        "default-src 'none'; "
    ]
    assert headers.get_all("X-Frame-Options") == ["DENY"]
    assert headers["Set-Cookie"] is None
    for way in ("/admin", "/admin/", "/nothing/"):  # nothing leads out of the path
        with pytest.raises(urllib.error.HTTPError, match="404") as error:
            urllib.request.urlopen(f"{public}{way}")
        error.value.close()


def test_an_unfilled_link_through_nginx_says_what_to_do(site):
    server, _ = site
    with chromium() as browser:
        someone = Participant(browser, link_of(server, "prolific"))
        someone.page.get_by_text("a part of it was never filled in").wait_for()
        someone.check(allow=["403"])
        someone.close()


def test_what_a_visitor_writes_before_the_proxys_address_is_not_believed(tmp_path):
    study = small_study(tmp_path / "s", design=EXP1)
    port = free_port()
    with ServerProcess(study, "--behind-proxy") as server:
        server.stop()
        places = server.command.index("--sessions-per-address") + 1
        server.command[places] = "3"
        server.start()
        key = server.lab.rpartition("=")[2]
        with nginx(tmp_path / "nginx", port, block_of_the_page(server.port)):
            said = [_begin(port, key, k) for k in range(5)]
    assert said == [201, 201, 201, 429, 429]


def _begin(port, key, number):
    body = f'{{"request": "request-{number}", "tab": "tab-00000001", "link": {{"lab": "{key}"}}}}'
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/pour/api/sessions",
        body.encode(),
        {"X-Forwarded-For": f"6.6.6.{number}", "Content-Type": "application/json"},
    )
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        error.close()
        return error.code
