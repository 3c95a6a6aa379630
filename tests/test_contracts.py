"""Every experiment, goal and liquid that is found keeps its kind's promises."""

import json

import numpy as np
import pytest
import shapely

from pourcast.models.registry import make_model
from pourcast.scenes.goals.registry import GOALS
from pourcast.scenes.liquids.registry import LIQUIDS, known_liquids, resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.folder import SceneRequest, generate_practice
from pourcast.study.selection import drawn_scene, filtered_scenes
from pourcast.sweep.grid import experiment_grid

WORDS = {"instructions", "quiz", "question", "slider", "low", "high", "value"}


def first_scene(experiment):
    draws = (drawn_scene(experiment.family, 0, k) for k in range(1000))
    return next(scene for scene in draws if scene is not None)


@pytest.fixture(params=EXPERIMENTS.names())
def experiment(request):
    return EXPERIMENTS.get(request.param)


@pytest.fixture(params=GOALS.names())
def goal(request):
    """A goal that is not its own mirror image, in a box 1 m wide."""
    kind = GOALS.get(request.param)
    moved = {name: 0.4 for name in kind.model_fields if name in ("divider_x", "centre_x")}
    return kind(**moved)


@pytest.fixture(params=LIQUIDS.names())
def liquid(request):
    return LIQUIDS.get(request.param)


def test_an_experiment_draws_valid_scenes_with_its_goal(experiment):
    scene = first_scene(experiment)
    assert scene.goal.kind == experiment.goal
    assert Scene.model_validate_json(scene.model_dump_json()) == scene
    assert drawn_scene(experiment.family, 0, 5) == drawn_scene(experiment.family, 0, 5)


def test_an_experiments_names_are_known(experiment):
    scene = first_scene(experiment)
    for name in experiment.shown_liquids:
        assert resolve_liquid(name, scene).called == name
        assert make_model(experiment.truth(name))
        assert make_model(experiment.observer_model(name))
    assert set(experiment.mirrored) <= set(experiment.shown_liquids)
    assert all(make_model(spec) for spec in experiment.models)
    assert next(experiment_grid(experiment).points())


def test_an_experiments_scenes_can_be_chosen(experiment):
    assert SceneRequest(experiment.name).scene_count == experiment.scene_count
    chosen = filtered_scenes(experiment.family, 2, 3, rule=experiment.choice.rule).scenes
    assert [scene.goal.kind for scene in chosen] == [experiment.goal] * 2
    practice = generate_practice(experiment, 2, 3)
    assert not {one.digest for one in practice} & {one.digest for one in chosen}


def test_a_goal_can_be_written_and_read(goal):
    scene = Scene(id="a", liquid={"centre": (0.5, 1.3)}, goal=goal)
    again = Scene.model_validate(json.loads(scene.model_dump_json()))
    assert again == scene
    assert again.digest == scene.digest
    assert again.goal.kind == goal.kind


def test_a_goal_mirrors_twice_to_itself_and_judges_alike(goal):
    there = goal.mirrored(1.0)
    back = there.mirrored(1.0)
    assert back.model_dump() == pytest.approx(goal.model_dump())
    rng = np.random.default_rng(0)
    points = rng.uniform((0.0, 0.0), (1.0, 1.5), (500, 2))
    held = np.mean([goal.holds(x, y) for x, y in points])
    in_mirror = np.mean([there.holds(1.0 - x, y) for x, y in points])
    assert goal.mirrored_judgment(in_mirror) == pytest.approx(held)
    shares = np.linspace(0.0, 1.0, 5)
    assert goal.mirrored_judgment(goal.mirrored_judgment(shares)) == pytest.approx(shares)


def test_a_goals_parts_are_convex_and_stand_below_its_rim(goal):
    for part in goal.solids:
        shape = shapely.Polygon(part)
        assert shape.is_valid
        assert shape.convex_hull.area == pytest.approx(shape.area)
        assert shape.bounds[3] <= goal.rim + 1e-9


def test_a_goal_says_what_it_asks(goal):
    assert goal.share
    english = goal.words["en"]
    assert set(english) == WORDS
    assert "{liquid}" in english["question"]
    for question in english["quiz"]:
        assert 0 <= question["right"] < len(question["choices"])
    for column in goal.answer_picture.columns:
        assert 0.0 <= column.x < column.x + column.width <= 1.0 + 1e-9
        assert 0.0 < column.full <= 1.0
    widths = [(c.width * c.full, c.judged) for c in goal.answer_picture.columns]
    judged, rest = (sum(w for w, j in widths if j is kind) for kind in (True, False))
    assert rest == pytest.approx(judged, rel=0.3) or rest == 0.0


def test_a_liquid_is_told_from_others_and_has_all_that_is_needed(liquid):
    assert [one.name for one in known_liquids()].count(liquid.name) == 1
    assert all(0.0 <= share <= 1.0 for share in (*liquid.rgb, *liquid.glass_rgb))
    assert liquid.film_seconds <= 60.0
    scene = Scene(id="a", liquid={"centre": (0.5, 1.3)})
    assert resolve_liquid(liquid.name, scene) == liquid
    assert resolve_liquid(liquid.called, scene).called == liquid.called
