"""Grid files: what they ask for, and how they are refused."""

from dataclasses import replace

import pytest

from pourcast import cli
from pourcast.errors import InputError
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.sweep.grid import (
    GridFile,
    GridModels,
    Range,
    experiment_grid,
    grid_names,
    make_grid,
    parse_grid,
    read_grid,
)
from pourcast.sweep.plan import make_plan
from pourcast.sweep.settings import PourSetting
from tests.make import random_scenes
from tests.sweep.make import SMALL, small_grid, small_study


def models_of(text):
    return [point.model for point in parse_grid(text, "g", "g.toml").points()]


def test_a_grid_is_the_product_of_its_values():
    grid = small_grid()
    asked = list(grid.points())
    assert len(asked) == 2 * 2 * 3 * 2 + 1 + 2 * 3 + 1
    assert len({(a.model, a.liquid, a.seed) for a in asked}) == len(asked)
    assert [a.model.damping_zeta for a in asked[:12:4]] == [4.0, 6.0, 8.0]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("{ from = 0, to = 0.2, count = 11 }", [0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2]),
        ("{ from = 0.1, to = 0.3, step = 0.1 }", [0.1, 0.2, 0.3]),
        ("[0.3, 0.1]", [0.3, 0.1]),
        ("0.25", [0.25]),
    ],
)  # fmt: skip
def test_values_and_ranges(value, expected):
    text = f'[[models]]\nmodel = "simple"\nparameters.m = {value}\n'
    assert [model.m for model in models_of(text)] == expected


def test_whole_numbers_stay_whole_and_others_become_floats():
    text = '[[models]]\nmodel = "ife"\nparameters.n_particles = { from = 20, to = 40, step = 10 }\n'
    counts = [model.n_particles for model in models_of(text)]
    assert counts == [20, 30, 40]
    assert all(type(count) is int for count in counts)
    (one,) = models_of('[[models]]\nmodel = "ife"\nparameters.damping_zeta = 3\n')
    assert type(one.damping_zeta) is float


def test_a_preset_keeps_its_own_values():
    (one,) = models_of('[[models]]\nmodel = "truth-water"\n')
    assert (one.n_particles, one.damping_zeta, one.liquid) == (200, 0.0, "water")


def test_the_papers_grids_need_the_papers_simulations():
    # Experiment 1: 10 N x 21 zeta of water, honey and marbles, 21 zeta at two more alpha, and
    # one truth (honey's is among the IFEs). Experiment 2: 21 zeta of water at three alpha, of
    # honey, and of marbles at two N; two truths.
    counts = (("paper-exp1", 120, 120 * (630 + 42 + 1)), ("paper-exp2", 60, 60 * (84 + 42 + 2)))
    for name, scene_count, expected in counts:
        plan = make_plan(read_grid(name), random_scenes(1))
        pours = [setting for setting in plan.settings if isinstance(setting, PourSetting)]
        assert scene_count * len(pours) == expected
    plan = make_plan(read_grid("paper-exp1"), random_scenes(1))
    simple = {
        s.model for s in plan.settings if not isinstance(s, PourSetting) and s.name == "simple"
    }
    assert sum(1 for model in simple if model.m_sigma == 0.04) == 121
    judged = [s.model for s in plan.settings if not isinstance(s, PourSetting)]
    noisy = [model for model in judged if hasattr(model, "position_sd")]
    assert {model.position_sd for model in noisy} == {0.025, 0.05, 0.1}


def test_every_named_grid_is_right_and_explains_itself():
    assert grid_names() == ["paper-exp1", "paper-exp2", "quick"]
    for name in grid_names():
        grid = read_grid(name)
        assert grid.name == name
        assert grid.content.title
        assert grid.text.startswith("#")


def test_trajectories_can_be_asked_for_later():
    grid = small_grid().with_trajectories()
    assert grid.content.trajectories
    assert parse_grid(grid.text, "again", "again.toml").content == grid.content
    assert grid.with_trajectories() is grid
    already_said = small_grid("trajectories = false\n" + SMALL).with_trajectories()
    assert parse_grid(already_said.text, "again", "again.toml").content.trajectories


def test_a_grid_is_an_object_whose_record_says_the_same():
    names = '\U0001f30a \\ " \n \x7f'
    entries = [
        GridModels(model="simple", liquids=("honey",), seeds=(1, 2), parameters={"g": [0, 0.5]}),
        GridModels(
            model="ife", parameters={"n_particles": "15", "damping_zeta": Range(first=0, last=2, step=1)}
        ),
    ]  # fmt: skip
    grid = make_grid("mine", GridFile(title=names, models=entries))
    again = parse_grid(grid.text, "mine", "mine.toml")
    assert again.content == grid.content
    assert list(again.points()) == list(grid.points())
    assert len(list(grid.points())) == 7
    with pytest.raises(
        InputError, match=r"^mine: models\[0\]: SimpleSim: g: expected 0 to 1, found 2"
    ):
        make_grid("mine", GridFile(models=[GridModels(model="simple", parameters={"g": 2})]))


BAD = {
    "not TOML": ("[[models", "g.toml: not a TOML file"),
    "nothing": ("", "g.toml: models: Field required"),
    "unknown key": ('[[models]]\nmodel = "ife"\nparametres.m = 1\n', r"models\[0\].parametres: Extra inputs"),
    "no such model": ('[[models]]\nmodel = "iffe"\n', r"g.toml: models\[0\]: model: there is no 'iffe'; did you mean"),
    "no such parameter": (
        '[[models]]\nmodel = "ife"\nparameters.n_particle = 20\n',
        r"models\[0\]: model 'ife': parameter: there is no 'n_particle'; did you mean 'n_particles'",
    ),
    "second entry": (
        '[[models]]\nmodel = "ife"\n[[models]]\nmodel = "simple"\nparameters.g = [0, 2]\n',
        r"models\[1\]: SimpleSim: g: expected 0 to 1, found 2",
    ),
    "not whole": ('[[models]]\nmodel = "ife"\nparameters.n_particles = 2.5\n', "n_particles: expected a whole number, found '2.5'"),
    "truth value": ('[[models]]\nmodel = "ife"\nparameters.n_particles = true\n', r"models\[0\].parameters.n_particles"),
    "no such liquid": ('[[models]]\nmodel = "ife"\nliquids = ["oil"]\n', "liquids: there is no 'oil'"),
    "empty list": ('[[models]]\nmodel = "ife"\nparameters.n_particles = []\n', "parameters.n_particles: the list is empty"),
    "no liquids": ('[[models]]\nmodel = "ife"\nliquids = []\n', r"models\[0\].liquids"),
    "bad step": (
        '[[models]]\nmodel = "ife"\nparameters.damping_zeta = { from = 0, to = 1, step = 0.3 }\n',
        "the step doesn't lead from `from` to `to`",
    ),
    "step and count": (
        '[[models]]\nmodel = "ife"\nparameters.damping_zeta = { from = 0, to = 1, step = 0.5, count = 3 }\n',
        "either `step` or `count`",
    ),
    "backwards": (
        '[[models]]\nmodel = "ife"\nparameters.damping_zeta = { from = 1, to = 0, step = 0.5 }\n', "`to` is less than `from`",
    ),
    "too many": (
        '[[models]]\nmodel = "simple"\nparameters.g = { from = 0, to = 1, count = 10001 }\n'
        "parameters.m = { from = 0, to = 1, count = 10001 }\n",
        "100020001 combinations of parameters; at most 1000000",
    ),
    "negative seed": ('[[models]]\nmodel = "simple"\nseeds = [-1]\n', r"models\[0\].seeds\[0\]"),
    "no time": ('shard_seconds = 0\n[[models]]\nmodel = "simple"\n', "g.toml: shard_seconds"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_grid_is_answered_in_one_line_and_nothing_runs(name, tmp_path, capsys):
    text, message = BAD[name]
    study, path = small_study(tmp_path), tmp_path / "g.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_grid(str(path))
    assert "\n" not in str(caught.value) or name == "not TOML"
    assert cli.run(["sweep", str(study), "--grid", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert [entry.name for entry in study.iterdir()] == ["scenes.json"]


def test_a_grid_that_is_not_there():
    with pytest.raises(InputError, match="there is no 'quik'; did you mean 'quick'"):
        read_grid("quik")
    with pytest.raises(InputError, match=r"no/g.toml: cannot be read"):
        read_grid("no/g.toml")


def test_an_experiment_sweeps_its_own_liquids():
    exp1 = EXPERIMENTS.get("exp1")
    assert experiment_grid(exp1).content == read_grid("paper-exp1").content
    grid = experiment_grid(replace(exp1, groups=(("water", "honey-exp2"),), grid="quick"))
    points = list(grid.points())
    imagined = {point.model.parameters().get("liquid") for point in points} - {None}
    assert imagined == {"water", "honey-exp2", "trial"}
    assert {point.liquid for point in points} == {"water", "honey-exp2"}
    assert "truth-honey" not in {point.name for point in points}
