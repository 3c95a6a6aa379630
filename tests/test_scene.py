"""Scenes: validation, mirror, digest, JSON, and no way to break the reader."""

import json
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pourcast.errors import InputError
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.scene import Box, LiquidStart, Scene
from pourcast.scenes.scene_file import (
    parse_scenes,
    read_scenes,
    scene_json_schema,
    scenes_to_json,
    write_scenes,
)
from tests.make import ramp_scene, random_scenes

SCHEMA = Path(__file__).parents[1] / "docs" / "reference" / "scenes.schema.json"


def as_json(**changes):
    """JSON content of a file with one scene, fields of the scene changed."""
    content = json.loads(scenes_to_json([ramp_scene()]))
    content["scenes"][0].update(changes)
    return content


SQUARE = [[0.1, 0.5], [0.2, 0.5], [0.2, 0.6], [0.1, 0.6]]

BAD_SCENES = {
    "crossing itself": (
        {"obstacles": [[[0.1, 0.5], [0.3, 0.7], [0.3, 0.5], [0.1, 0.7]]]},
        r"scenes\[0\]\.obstacles: obstacle 0: the polygon crosses itself",
    ),
    "pentagram": (
        {"obstacles": [[[0.5, 0.7], [0.6, 0.4], [0.35, 0.6], [0.65, 0.6], [0.4, 0.4]]]},
        "crosses itself",
    ),
    "not convex": (
        {"obstacles": [SQUARE, [[0.3, 0.5], [0.5, 0.5], [0.4, 0.55], [0.4, 0.8]]]},
        "obstacle 1: the polygon is not convex",
    ),
    "two corners": ({"obstacles": [SQUARE[:2]]}, "at least 3 vertices"),
    "no area": ({"obstacles": [[[0.1, 0.5], [0.2, 0.5], [0.3, 0.5]]]}, "no area"),
    "twin corners": ({"obstacles": [[*SQUARE, SQUARE[-1]]]}, "vertices 3 and 4 coincide"),
    "in the liquid": (
        {"obstacles": [[[0.35, 1.2], [0.45, 1.2], [0.4, 1.3]]]},
        r"scenes\[0\]: obstacle 0 overlaps the liquid's start",
    ),
    "outside": (
        {"obstacles": [[[0.9, 0.5], [1.2, 0.5], [1.0, 0.7]]]},
        "obstacle 0 is outside the box of 1 m x 1.5 m",
    ),
    "pixels": ({"box": {"width": 800}}, r"box\.width: .*metres.*found 800"),
    "liquid outside": (
        {"liquid": {"centre": [0.01, 1.3]}}, "liquid: the cylinder is not inside the box",
    ),
    "text as number": (
        {"obstacles": [[["0.1", 0.5], [0.2, 0.5], [0.2, 0.6]]]}, "Input should be a number",
    ),
    "negative diameter": (
        {"liquid": {"centre": [0.4, 1.3], "diameter": -1}}, r"liquid\.diameter: expected a length in metres, more than 0",
    ),
    "unknown goal": ({"goal": {"kind": "bucket"}}, "goal"),
    "goal over the liquid": (
        {"goal": {"kind": "basins", "divider_x": 0.4, "divider_height": 1.3}},
        r"goal \(basins\) overlaps the liquid's start",
    ),
    "closed cup": ({"goal": {"kind": "cup", "width": 0.03}}, "leave no room inside"),
    "unknown field": ({"colour": "red"}, r"scenes\[0\]\.colour: Extra inputs"),
    "empty id": ({"id": ""}, r"scenes\[0\]\.id"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_SCENES)
def test_bad_scene_is_named_in_one_line(name):
    changes, message = BAD_SCENES[name]
    with pytest.raises(InputError, match=message) as caught:
        parse_scenes(json.dumps(as_json(**changes)), "a.json")
    assert str(caught.value).startswith("a.json: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not a JSON file"),
        ("[]", "expected an object"),
        ("[" * 100_000, "not a JSON file"),
        ("{}", "schema_version: expected 1, found null"),
        ('{"schema_version": 2, "scenes": []}', "schema_version: expected 1, found 2"),
        ('{"schema_version": true}', "schema_version: expected 1, found true"),
        ('{"schema_version": 1, "scenes": []}', "the list is empty"),
        ('{"schema_version": 1}', "scenes: Field required"),
        ('{"schema_version": 1, "scenes": 5}', "scenes: "),
        (json.dumps(as_json()).replace("0.148", "NaN", 1), "finite number"),
        (json.dumps(as_json()).replace("0.148", "Infinity", 1), "finite number"),
        (json.dumps(as_json() | {"units": "cm"}), "units: Input should be 'm'"),
    ],
)
def test_bad_file_is_named_in_one_line(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_scenes(text, "a.json")
    assert str(caught.value).startswith("a.json: ")


def test_two_scenes_of_one_id_are_refused():
    content = as_json()
    content["scenes"] *= 2
    with pytest.raises(InputError, match="two scenes have the id 'ramp'"):
        parse_scenes(json.dumps(content), "a.json")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.json: cannot be read \(No such file"):
        read_scenes(tmp_path / "nowhere.json")


def test_clockwise_polygons_are_turned_round():
    scene = ramp_scene()
    turned = scene.model_copy(update={})
    clockwise = Scene(**{**turned.model_dump(), "obstacles": [p[::-1] for p in scene.obstacles]})
    assert clockwise.obstacles[0] in {
        scene.obstacles[0][k:] + scene.obstacles[0][:k] for k in range(3)
    }


def test_scenes_survive_a_round_trip(tmp_path):
    scenes = [s.model_copy(update={"id": str(k)}) for k, s in enumerate(random_scenes(20))]
    path = tmp_path / "deep" / "scenes.json"
    write_scenes(path, scenes)
    assert read_scenes(path) == scenes
    assert path.read_text() == scenes_to_json(read_scenes(path))
    assert [p.name for p in path.parent.iterdir()] == ["scenes.json"]


def test_mirror_is_its_own_inverse_and_moves_the_goal():
    for scene in random_scenes(20, seed=1):
        assert scene.mirrored().mirrored().digest == scene.digest
    cup = Scene(id="c", liquid=LiquidStart(centre=(0.3, 1.0)), goal=Cup(centre_x=0.2))
    assert cup.mirrored().goal.centre_x == pytest.approx(0.8)
    assert cup.mirrored().liquid.centre == (0.7, 1.0)


def test_digest_names_the_content_not_the_id():
    scene = ramp_scene()
    assert scene.digest == scene.model_copy(update={"id": "other"}).digest
    moved = scene.model_copy(update={"liquid": LiquidStart(centre=(0.41, 1.3))})
    assert moved.digest != scene.digest
    # Frozen: a change of it would orphan everything that is stored under the digest.
    assert scene.digest == "45cd3a64d55e"


def test_goals_hold_what_they_should():
    assert Basins(divider_x=0.5).holds(0.51, 0.0)
    assert not Basins(divider_x=0.5).holds(0.49, 0.0)
    cup = Cup(centre_x=0.5, width=0.3, height=0.2)
    assert cup.holds(0.6, 0.1)
    assert not cup.holds(0.6, 0.3)
    assert not cup.holds(0.7, 0.1)


def test_published_schema_is_current_and_accepts_what_we_write():
    published = json.loads(SCHEMA.read_text())
    assert published == scene_json_schema()
    content = json.loads(scenes_to_json(random_scenes(1)))
    jsonschema.validate(content, published)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(as_json(liquid={}), published)


def test_scenes_are_immutable():
    with pytest.raises(ValueError, match="frozen"):
        ramp_scene().id = "other"
    with pytest.raises(ValueError, match="frozen"):
        Box().width = 3.0


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)
coordinates = st.tuples(st.floats(-0.2, 1.2), st.floats(-0.2, 1.7)).map(list)


@given(st.one_of(st.text(), st.binary(), json_values.map(json.dumps)))
def test_any_text_is_read_or_refused_in_one_line(text):
    assert_read_or_refused(text)


@given(
    obstacles=st.lists(st.lists(coordinates, max_size=6), max_size=4),
    field=st.sampled_from(["id", "box", "liquid", "goal", "obstacles"]),
    value=json_values,
    replace=st.booleans(),
)
def test_any_scene_is_read_or_refused_in_one_line(obstacles, field, value, replace):
    changes = {"obstacles": obstacles} | ({field: value} if replace else {})
    assert_read_or_refused(json.dumps(as_json(**changes)))


def assert_read_or_refused(text):
    try:
        scenes = parse_scenes(text, "f.json")
    except InputError as error:
        assert str(error).startswith("f.json: ")
        assert "\n" not in str(error)
    else:
        assert parse_scenes(scenes_to_json(scenes), "again") == scenes
