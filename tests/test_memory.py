"""Pours of several models go through one queue, each once; a process remembers their outcomes."""

import tracemalloc
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pourcast import cli
from pourcast.engine.packing import _packing, pack_cylinder, unit_cylinder_packing
from pourcast.errors import ModelError, SimulationDivergedError
from pourcast.models.base import SimulationModel
from pourcast.models.registry import make_model
from pourcast.pictures.predictions import make_predictions
from pourcast.pictures.show import show
from pourcast.prediction import JudgmentRequest, judge_together, predict
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene_file import write_scenes
from pourcast.simulation import memory
from pourcast.simulation.memory import REMEMBERED, OutcomeMemory, outcomes_of
from pourcast.simulation.pour import Outcome, Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.selection import CoarseFilter, ContrastingScenes
from tests.make import ramp_scene, random_scenes

FIVE, SIX = (f"ife:n_particles=5,damping_zeta={zeta},zeta_sigma=1" for zeta in (5, 6))
MARBLES = "marble:n_particles=5,zeta_sigma=0"
DRAWS = "position-uncertainty:n_particles=5,n_draws=3"


def dampings(pours):
    return sorted(pour.damping_zeta for pour in pours)


def test_models_pour_together_and_what_their_windows_share_only_once(poured):
    predict([ramp_scene()], [FIVE, SIX, "gravity"])
    (pours,) = poured
    assert dampings(pours) == [4.0, 5.0, 6.0, 7.0]


def test_judgments_have_the_same_bits_in_any_company_and_without_memory():
    scenes, specs = random_scenes(4, seed=3), [FIVE, DRAWS, MARBLES, SIX, "simple"]
    together = predict(scenes, specs, seed=1).set_index(["model", "scene"])["judgment"]
    again = predict(scenes[::-1], specs[::-1], seed=1).set_index(["model", "scene"])["judgment"]
    REMEMBERED.forget_all()
    for spec in specs:
        by_itself = make_model(spec).judge(scenes, WATER, 1)
        alone = predict(scenes[2:], [spec], seed=1)["judgment"].to_numpy()
        ids = [scene.id for scene in scenes]
        assert (together[spec][ids].to_numpy() == by_itself).all()
        assert (again[spec][ids].to_numpy() == by_itself).all()
        assert (alone == by_itself[2:]).all()


def test_a_model_asked_by_itself_remembers_nothing(poured):
    model, scene = make_model(FIVE), ramp_scene()
    for _ in range(2):
        model.judge([scene, scene], WATER)
    assert [len(pours) for pours in poured] == [3, 3]


def test_what_was_poured_is_not_poured_again(poured):
    first = predict([ramp_scene()], [FIVE])
    assert predict([ramp_scene()], [FIVE]).equals(first)
    predict([ramp_scene()], [SIX])
    assert [dampings(pours) for pours in poured] == [[4.0, 5.0, 6.0], [7.0]]


def test_what_is_to_be_shown_is_recorded_where_it_is_judged(poured, tmp_path):
    models, scene = [FIVE, MARBLES, "gravity"], ramp_scene()
    predict([scene], models, record=models)
    before = len(poured)
    shown = show(scene, tmp_path / "one.png", models)
    assert len(poured) == before == 1
    REMEMBERED.forget_all()
    assert [one.judgment for one in show(scene, tmp_path / "two.png", models)] == [
        one.judgment for one in shown
    ]
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_only_a_typical_pour_is_run_again_to_be_shown(poured):
    predict([ramp_scene()], [FIVE])
    (one,) = make_predictions(ramp_scene(), [FIVE], WATER)
    assert [dampings(pours) for pours in poured] == [[4.0, 5.0, 6.0], [5.0]]
    (end,) = simulate([Pour(ramp_scene(), WATER, 5, 5.0)], record=True)
    assert (one.frames == end.frames).all()


def test_nobody_can_write_into_what_is_remembered():
    (one,) = make_predictions(ramp_scene(), [FIVE], WATER)
    with pytest.raises(ValueError, match="read-only"):
        one.frames[:] = 0.0


POUR = Pour(ramp_scene(), WATER, 5, 5.0)


class UpsideDown(Basins):
    """Has all fields of basins, but means the other side."""

    def holds(self, x, y):
        return not super().holds(x, y)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_numpys_numbers_decide_what_pythons_do(kind):
    numpys = replace(POUR, offset=(kind(0.1), kind(0.0)), damping_zeta=kind(5.1))
    pythons = replace(POUR, offset=(float(kind(0.1)), 0.0), damping_zeta=float(kind(5.1)))
    ends = simulate([numpys, pythons])
    assert ends[0].position.tobytes() == ends[1].position.tobytes()
    step = kind(1 / 30 / 90)
    one, other = EngineSettings(step=step), EngineSettings(step=float(step))
    assert one.stepping("liquid", 0.04, 0.0) == other.stepping("liquid", 0.04, 0.0)


def test_no_packing_is_kept_that_a_narrow_number_made():
    radius, depth = 0.05, 0.113  # of no other test
    narrow = pack_cylinder(np.int16(300), (0.0, 0.0), radius, depth)
    unit_cylinder_packing.cache_clear()
    assert (narrow == pack_cylinder(300, (0.0, 0.0), radius, depth)).all()
    made = _packing(300, round(depth / radius, 6)) * radius
    assert (narrow == made.astype(np.float32)).all()


def in_scene(**changes):
    return replace(POUR, scene=POUR.scene.model_copy(update=changes))


@pytest.mark.parametrize(
    "other",
    [
        in_scene(id="another"),
        replace(POUR, liquid=replace(WATER, name="rain", called="rain", colour="#000000")),
        replace(POUR, n_particles=np.int64(5), damping_zeta=5),
    ],
    ids=["id", "name and colour", "kind of number"],
)
def test_pours_are_the_same_if_nothing_differs_that_decides_them(poured, other):
    one, two = outcomes_of([POUR, other], lambda outcome: outcome)
    assert len(poured[0]) == 1
    assert one is two


@pytest.mark.parametrize(
    "other",
    [
        in_scene(obstacles=()),
        in_scene(goal=Basins(divider_x=0.45)),
        in_scene(goal=UpsideDown()),
        in_scene(box=POUR.scene.box.model_copy(update={"depth": 0.15})),
        in_scene(liquid=POUR.scene.liquid.model_copy(update={"centre": (0.41, 1.3)})),
        replace(POUR, liquid=HONEY_EXP1),
        replace(POUR, n_particles=6),
        replace(POUR, damping_zeta=5.5),
        replace(POUR, offset=(0.0, 0.001)),
        replace(POUR, kind="marbles"),
    ],
    ids=[
        "obstacles", "goal", "kind of goal", "box", "start", "liquid", "particles", "damping",
        "offset", "marbles",
    ],
)  # fmt: skip
def test_pours_are_different_if_anything_differs_that_decides_them(poured, other):
    def positions(outcome):
        return outcome.judgment, outcome.position.tobytes()

    both = outcomes_of([POUR, other], positions, memory=REMEMBERED)
    assert len(poured[0]) == 2
    assert both == [positions(simulate([pour])[0]) for pour in (POUR, other)]


def test_pours_of_other_engine_settings_are_different(poured):
    settings = EngineSettings(max_duration=0.1)
    long, short = (
        outcomes_of([POUR], lambda outcome: outcome.time, settings=one, memory=REMEMBERED)[0]
        for one in (None, settings)
    )
    assert len(poured) == 2
    assert short == pytest.approx(0.1, abs=0.04)
    assert long > 0.2


def outcome_of(n_particles, frame_count=0):
    frames = np.zeros((frame_count, n_particles, 3), np.float32) if frame_count else None
    end = np.zeros((n_particles, 3), np.float32)
    return Outcome(0.5, 0.0, 1.0, 1.0, True, end, frames)


@pytest.mark.parametrize(("n_particles", "frame_count"), [(1, 0), (100, 0), (50, 100)])
def test_memory_is_bounded_in_bytes(n_particles, frame_count):
    most = 2**20
    tracemalloc.start()
    try:
        remembered = OutcomeMemory(most)
        before, _ = tracemalloc.get_traced_memory()
        for number in range(3000):
            identity = (f"digest {number}", Basins, (0.1, 0.0, 0.0), 5, 0.5 * number, (0.0, 0.0))
            remembered.keep(identity, outcome_of(n_particles, frame_count))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert 0.2 * most < after - before < most
    assert remembered.find(identity) is not None
    assert remembered.find(("digest 0", *identity[1:])) is None


def test_what_was_not_used_for_longest_is_forgotten_first():
    remembered = OutcomeMemory(10_000)
    for name in "abc":
        remembered.keep((name,), outcome_of(100))
    assert remembered.find(("a",)) is not None
    remembered.keep(("d",), outcome_of(100))
    assert [name for name in "abcd" if remembered.find((name,)) is not None] == ["a", "c", "d"]
    remembered.keep(("e",), outcome_of(10_000))
    assert not [name for name in "abcde" if remembered.find((name,)) is not None]


def test_many_pours_are_held_piece_by_piece(poured, monkeypatch):
    scenes, seen = random_scenes(5, seed=3), []
    whole = predict(scenes, [FIVE, DRAWS])
    REMEMBERED.forget_all()
    monkeypatch.setattr(memory, "PIECE", 10_000)
    report = lambda *told: seen.append(told)  # noqa: E731
    assert predict(scenes, [FIVE, DRAWS], report=report).equals(whole)
    assert [len(pours) for pours in poured] == [30, *[4] * 7, 2]
    assert {what for what, _, _ in seen} == {"2 models"}
    counts = sorted({done for _, done, _ in seen})
    assert counts == list(range(31))
    assert {total for _, _, total in seen} == {30}


def test_progress_names_a_model_that_pours_alone():
    seen = []
    predict([ramp_scene()], ["gravity", FIVE], report=lambda *told: seen.append(told))
    assert seen[-1] == (FIVE, 3, 3)
    assert {what for what, _, _ in seen} == {"gravity", FIVE}


@dataclass(frozen=True)
class Failing(SimulationModel):
    """Cannot say what to pour."""

    def pours(self, scene, liquid, seed=0):
        raise KeyError("viscosity")


class Unsure(Basins):
    """Fails when a pour is over."""

    def holds(self, x, y):
        raise ZeroDivisionError("nothing there")


def request(spec, model, scene):
    return JudgmentRequest(spec, model, [scene], WATER)


def test_a_model_that_fails_is_named_before_anything_is_poured(poured):
    good, bad = make_model(FIVE), Failing()
    with pytest.raises(ModelError, match="model 'bad' failed: KeyError: 'viscosity'"):
        judge_together(
            [request("good", good, ramp_scene()), request("bad", bad, ramp_scene())], seed=0
        )
    assert poured == []


def test_a_goal_that_fails_is_told_of_in_a_line():
    scene = ramp_scene().model_copy(update={"goal": Unsure()})
    with pytest.raises(ModelError, match="'one, two' failed: ZeroDivisionError: nothing there"):
        judge_together([request(name, make_model(FIVE), scene) for name in ("one", "two")], seed=0)


def test_a_broken_pour_among_those_of_other_models_is_named():
    wild = EngineSettings(step=4e-3, courant=100)
    pours = [replace(POUR, kind="marbles"), Pour(ramp_scene(), WATER, 50)]
    with pytest.raises(
        SimulationDivergedError, match=r"scene 'ramp', 50 particles of 'water' \(.*step=0.004"
    ):
        outcomes_of(pours, lambda outcome: outcome.judgment, settings=wild, memory=REMEMBERED)


def test_an_interruption_ends_the_work_at_once(poured, monkeypatch):
    monkeypatch.setattr(memory, "PIECE", 10_000)

    def interrupt(what, done, total):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        predict(random_scenes(5, seed=3), [FIVE, DRAWS], report=interrupt)
    assert [len(pours) for pours in poured] == [4, 4]
    # What was done by then is remembered.
    predict(random_scenes(5, seed=3), [FIVE, DRAWS])
    assert sum(len(pours) for pours in poured[2:]) == 26


def test_runs_of_the_filter_serve_the_screen_and_the_models(poured):
    choice = ContrastingScenes(
        rule=CoarseFilter(n_particles=6, max_stranded=0.5, min_touched=0.5),
        candidates=20,
        models=(
            "ife:n_particles=6,zeta_sigma=1,liquid=water",
            "ife:n_particles=6,zeta_sigma=1,liquid=honey",
        ),
    )
    words = set()
    choice.choose(EXPERIMENTS.get("exp2").family, 4, 0, lambda what, *_: words.add(what))
    pours = [pour for call in poured for pour in call]
    kept = {(p.scene.digest, p.liquid.name, p.damping_zeta) for p in pours}
    assert len(kept) == len(pours)
    # The filter's, the other liquid's screen, and the rest of both windows for ten scenes.
    assert [len(call) for call in poured[-2:]] == [20, 40]
    assert "screening with water and honey-exp2" in words


def test_the_command_pours_together(poured, tmp_path, capsys):
    path = tmp_path / "scenes.json"
    write_scenes(path, random_scenes(2, seed=3))
    assert cli.run(["predict", str(path), "-m", FIVE, "-m", SIX, "-m", MARBLES]) == 0
    assert [len(pours) for pours in poured] == [10]
    capsys.readouterr()
