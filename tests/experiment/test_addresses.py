"""Whom a request comes from: what proxies of ours wrote, and never what a client wrote."""

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route
from starlette.testclient import TestClient

from pourcast.errors import InputError
from pourcast.experiment.server.addresses import ForwardedAddress, Proxies, visitors_place
from pourcast.experiment.server.process import Address
from tests.experiment.conftest import api_of
from tests.experiment.make import small_study

HERE = "127.0.0.1"


@pytest.mark.parametrize(
    ("proxies", "peer", "forwarded", "client"),
    [
        # Nobody is believed without being asked for.
        (Proxies(), HERE, ["6.6.6.6"], HERE),
        # One proxy on this machine: the last entry is its own, all before it the client's.
        (Proxies(1), HERE, ["1.2.3.4"], "1.2.3.4"),
        (Proxies(1), HERE, ["6.6.6.6", "1.2.3.4"], "1.2.3.4"),
        (Proxies(1), HERE, ["6.6.6.6", HERE], HERE),
        (Proxies(1), HERE, [], HERE),
        (Proxies(1), HERE, ["6.6.6.6", "unknown"], HERE),
        (Proxies(1), HERE, ["6.6.6.6", ""], HERE),
        (Proxies(1), "::1", [" [2001:db8::1]:443 "], "2001:db8::1"),
        (Proxies(1), "::ffff:127.0.0.1", ["1.2.3.4:555"], "1.2.3.4"),
        # Who comes past it is believed nothing.
        (Proxies(1), "9.9.9.9", ["6.6.6.6"], "9.9.9.9"),
        # Two, the outer one anywhere.
        (Proxies(2), HERE, ["6.6.6.6", "1.2.3.4", "8.8.8.8"], "1.2.3.4"),
        (Proxies(2), HERE, ["8.8.8.8"], "8.8.8.8"),
        # Two, and where they are: who comes past the outer one is believed nothing.
        (Proxies(2, ("8.8.0.0/16",)), HERE, ["6.6.6.6", "1.2.3.4", "8.8.8.8"], "1.2.3.4"),
        (Proxies(2, ("8.8.0.0/16",)), HERE, ["6.6.6.6", "1.2.3.4"], "1.2.3.4"),
        (Proxies(1, ("10.0.0.0/8",)), "10.1.2.3", ["6.6.6.6", "1.2.3.4"], "1.2.3.4"),
        (Proxies(1, ("10.1.2.3",)), "10.1.2.4", ["1.2.3.4"], "10.1.2.4"),
        (Proxies(1, ("fd00::/8",)), "fd00::7", ["1.2.3.4"], "1.2.3.4"),
    ],
)
def test_each_proxy_is_believed_for_one_address(proxies, peer, forwarded, client):
    assert proxies.client(peer, forwarded) == client


@pytest.mark.parametrize("headers", [
    [("X-Forwarded-For", "6.6.6.6, 1.2.3.4")],
    [("X-Forwarded-For", "6.6.6.6"), ("X-Forwarded-For", "1.2.3.4")],
])  # fmt: skip
def test_a_header_that_comes_twice_is_one_list_and_no_other_is_believed(headers):
    async def say(request):
        return PlainTextResponse(f"{request.client.host} {request.url.scheme} {request.url.netloc}")

    app = ForwardedAddress(Starlette(routes=[Route("/", say)]), Proxies(1))
    client = TestClient(app, client=(HERE, 5), base_url="http://here")
    others = [
        ("X-Forwarded-Proto", "https"),
        ("X-Forwarded-Host", "evil"),
        ("X-Real-IP", "5.5.5.5"),
    ]
    assert client.get("/", headers=[*headers, *others]).text == "1.2.3.4 http here"


@pytest.mark.parametrize(
    ("address", "place"),
    [
        ("1.2.3.4", "1.2.3.4"),
        ("::ffff:1.2.3.4", "1.2.3.4"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::7", "2001:db8:1:2::/64"),
        ("testclient", "testclient"),
    ],
)
def test_an_ipv6_household_is_one_place(address, place):
    assert visitors_place(address) == place


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Proxies(1, ("10.0.0.0/99",)), "trusted-proxy: expected an address or network"),
        (lambda: Proxies(-1), "proxy-hops: expected 0 or more"),
        (lambda: Address("0.0.0.0", proxies=Proxies(1)), "host: at 0.0.0.0 anybody can come past"),
    ],
)
def test_what_is_no_proxy_is_told_of(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_one_script_cannot_take_all_places_by_writing_addresses(tmp_path):
    study = small_study(tmp_path)
    with api_of(study, sessions_per_address=3) as api:
        client = TestClient(ForwardedAddress(api.client.app, Proxies(1)), client=(HERE, 5))

        def begin(number, forwarded):
            link = {"PROLIFIC_PID": f"{number:024x}", "STUDY_ID": "s", "SESSION_ID": f"t{number}"}
            content = {"request": f"request-{number}", "tab": "tab-00000001", "link": link}
            headers = {"X-Forwarded-For": forwarded}
            return client.post("/api/sessions", json=content, headers=headers).status_code

        said = [begin(k, f"{k}.6.6.6, 1.2.3.4") for k in range(1, 6)]
        assert said == [201, 201, 201, 429, 429]
        said = [begin(k, f"2001:db8:1:2::{k}") for k in range(6, 11)]
        assert said == [201, 201, 201, 429, 429]
        assert begin(12, "5.6.7.8") == 201
