"""Anything may be sent to the API: it never fails, and never says how it is made."""

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.experiment.conftest import api_of
from tests.experiment.make import answer, small_study

TEXT = st.text(max_size=60)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=12,
)
KINDS = ("consent", "check", "instructions", "judgment", "film", "debrief")


@st.composite
def nearly_right(draw):
    """What the page posts, with a field or two that it would never send."""
    body = dict(answer(draw(st.sampled_from(KINDS))))
    for _ in range(draw(st.integers(0, 2))):
        body[draw(st.sampled_from([*body, "extra"]))] = draw(JSON)
    return {"tab": draw(st.just("tab-00000001") | TEXT), "body": body}


CONTENT = st.one_of(
    nearly_right(),
    JSON,
    st.fixed_dictionaries(
        {"request": st.just("request-9") | TEXT, "tab": st.just("tab-00000001"), "link": JSON}
    ),
    st.dictionaries(TEXT, TEXT, max_size=25).map(
        lambda link: {"request": "request-8", "tab": "tab-00000001", "link": link}
    ),
).map(lambda content: json.dumps(content).encode()) | st.binary(max_size=100)

PATHS = st.one_of(
    st.integers(-1, 40).map(lambda seq: f"/api/session/records/{seq}"),
    st.integers().map(lambda seq: f"/api/session/records/{seq}"),
    st.sampled_from(
        ["/api/sessions", "/api/session/resume", "/api/session/finish", "/", "/admin", "/media/x",
         "/admin/trials.csv", "/assets/app.js", "/assets/..%2f..%2findex.html", "/media/%2e%2e/x"]
    ),
    st.text(
        st.characters(codec="ascii", exclude_categories=["C"]), min_size=1, max_size=30
    ).map(lambda text: "/" + text.lstrip("/")),
)  # fmt: skip
HEADER = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=60)


@pytest.fixture(scope="module")
def hostile_api(tmp_path_factory):
    with api_of(small_study(tmp_path_factory.mktemp("hostile")), sessions_per_address=50) as api:
        yield api, api.begin().json()["token"]


def _never_fails(api, token, data):
    method = data.draw(st.sampled_from(["GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS"]))
    path = data.draw(PATHS)
    header = data.draw(st.just(f"Bearer {token}") | HEADER)
    said = api.client.request(
        method, path, content=data.draw(CONTENT), headers={"Authorization": header}
    )
    assert said.status_code < 500, (method, path, said.text)
    assert "Traceback" not in said.text
    assert 'File "' not in said.text


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_nothing_that_is_sent_makes_it_fail(hostile_api, data):
    _never_fails(*hostile_api, data)


@pytest.mark.slow
@settings(max_examples=3_000, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_nothing_in_thousands_of_requests_makes_it_fail(hostile_api, data):
    _never_fails(*hostile_api, data)


@pytest.mark.study
@settings(max_examples=10_000, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_nothing_in_ten_thousand_requests_makes_it_fail(hostile_api, data):
    _never_fails(*hostile_api, data)


@pytest.mark.parametrize(
    "step", ["9" * 5000, "9" * 20, "-1", "0x1", "1.0", "\N{ARABIC-INDIC DIGIT ONE}"]
)
def test_a_step_that_is_no_number_is_none(hostile_api, step):
    api, token = hostile_api
    said = api.put({"token": token}, step, answer("consent"))
    assert said.status_code == 404
