"""Scene families and the choice among their draws."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pourcast.errors import InputError
from pourcast.files import finished_files
from pourcast.models.registry import make_model
from pourcast.pictures.demo import demo_scenes
from pourcast.scenes.families.shapes import ShapesFamily
from pourcast.scenes.families.voronoi import VoronoiFamily, bounded_voronoi
from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.polygons import convex_pieces
from pourcast.scenes.scene_file import scenes_to_json
from pourcast.study import folder
from pourcast.study.chosen import read_chosen, write_chosen
from pourcast.study.experiments.registry import EXPERIMENTS, experiment_like
from pourcast.study.folder import (
    SceneRequest,
    load_practice,
    load_scenes,
    new_study,
    open_study,
)
from pourcast.study.selection import (
    CoarseFilter,
    ContrastingScenes,
    Selection,
    choose_contrast,
    drawn_scene,
    filtered_scenes,
)


def draws(family, count=40):
    found = (drawn_scene(family, 0, index) for index in range(count))
    return [scene for scene in found if scene is not None]


def test_voronoi_cells_tile_the_box():
    cells = [shapely.Polygon(p) for p in bounded_voronoi(np.random.default_rng(0), 70, 1.0, 1.5)]
    assert len(cells) == 70
    assert sum(cell.area for cell in cells) == pytest.approx(1.5, abs=1e-4)
    assert shapely.union_all(cells).area == pytest.approx(1.5, abs=1e-4)


def test_experiment_1_scenes_are_as_the_paper_says():
    family = VoronoiFamily()
    scenes = draws(family)
    assert len(scenes) > 30
    for scene in scenes:
        area = sum(shapely.Polygon(p).area for p in scene.obstacles)
        assert area == pytest.approx(0.12, rel=0.051)
        heights = np.array([y for p in scene.obstacles for _, y in p])
        assert heights.min() >= family.band_bottom
        assert heights.max() <= family.band_top
        assert (scene.box.width, scene.box.height, scene.liquid.diameter) == (1.0, 1.5, 0.148)
        assert scene.goal.kind == "basins"
        assert scene.goal.divider_x == 0.5


def test_experiment_2_scenes_are_as_the_paper_says():
    scenes = draws(ShapesFamily(), 80)
    sides = {len(p) for scene in scenes for p in scene.obstacles}
    assert sides == {3, 4, 32}
    places = set()
    for scene in scenes:
        assert len(scene.obstacles) == 3
        assert isinstance(scene.goal, Cup)
        assert scene.goal.width == pytest.approx(1 / 3, abs=1e-6)
        places.add(scene.goal.centre_x)
        for p in scene.obstacles:
            corners = np.array(p)
            edges = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
            assert edges == pytest.approx(edges[0], abs=1e-5)
    assert sorted(places) == pytest.approx([1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6], abs=1e-5)


@pytest.mark.parametrize("family", [VoronoiFamily(), ShapesFamily()])
def test_filtered_scenes_are_the_same_for_a_seed_and_pass_the_filter(family):
    seen = []
    first = filtered_scenes(family, 12, 3, report=lambda *report: seen.append(report))
    again = filtered_scenes(family, 5, 3)
    assert scenes_to_json(first.scenes[:5]) == scenes_to_json(again.scenes)
    assert [s.id for s in first.scenes][:2] == [f"{family.name}-001", f"{family.name}-002"]
    assert all(CoarseFilter().keeps(first.scenes))
    assert 0 < first.kept <= first.drawn
    assert seen[-1][1:] == (12, 12)
    assert "draws kept" in seen[-1][0]
    other = filtered_scenes(family, 2, 4).scenes
    assert other[0].digest != first.scenes[0].digest


def test_filter_drops_what_traps_and_what_misses():
    strict = CoarseFilter(max_stranded=-1.0)
    assert not any(strict.keeps(draws(VoronoiFamily(), 6)))
    untouched = CoarseFilter(min_touched=1.1)
    assert not any(untouched.keeps(draws(VoronoiFamily(), 6)))


def test_a_family_that_never_passes_is_reported():
    class Hopeless:
        name = "hopeless"

        def draw(self, rng, scene_id):
            return None

    with pytest.raises(InputError, match="only 0 of 2048 drawn hopeless scenes pass"):
        filtered_scenes(Hopeless(), 1, 0)


def test_contrast_is_chosen_in_both_directions():
    # A cloud with correlation +0.8, as unselected scenes have it.
    rng = np.random.default_rng(0)
    water, honey = np.clip(
        rng.multivariate_normal([0.4, 0.4], [[0.09, 0.072], [0.072, 0.09]], 3000), 0, 1
    ).T
    assert np.corrcoef(water, honey)[0, 1] > 0.7
    chosen = choose_contrast(water, honey, 60)
    assert len(set(chosen)) == 60
    assert np.corrcoef(water[chosen], honey[chosen])[0, 1] < -0.7
    assert np.sum(water[chosen] > honey[chosen] + 0.1) >= 25
    assert np.sum(honey[chosen] > water[chosen] + 0.1) >= 25


def test_contrasting_scenes_from_a_small_pool():
    choice = ContrastingScenes(candidates=60)
    chosen, again = (choice.choose(ShapesFamily(), 6, 1) for _ in range(2))
    assert scenes_to_json(chosen.scenes) == scenes_to_json(again.scenes)
    both = "correlation of water-ife and honey-ife-1"
    assert chosen.figures[f"{both}, all candidates"] > 0.5
    assert chosen.figures[both] < 0.0
    assert len(choice.stages) == len(chosen.left)
    with pytest.raises(InputError, match="candidates: expected at least 6"):
        ContrastingScenes(candidates=5).choose(ShapesFamily(), 6, 1)


stars = st.lists(st.floats(0.1, 0.4), min_size=3, max_size=9)


@given(stars)
def test_any_star_is_split_into_convex_pieces_that_cover_it(radii):
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    star = shapely.Polygon(np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1) + 0.5)
    pieces = [shapely.Polygon(p) for p in convex_pieces(star)]
    assert sum(p.area for p in pieces) == pytest.approx(star.area, abs=1e-4)
    for piece in pieces:
        assert piece.convex_hull.area == pytest.approx(piece.area, abs=1e-9)
        assert piece.exterior.is_ccw


def test_a_study_that_was_interrupted_is_gone_on_with(tmp_path):
    request = SceneRequest("exp1", 2, 3)
    new_study(tmp_path / "whole", request)
    whole = (tmp_path / "whole" / "scenes.json").read_bytes()
    (tmp_path / "whole" / "scenes.json").unlink()
    scenes = open_study(tmp_path / "whole", request)
    assert (tmp_path / "whole" / "scenes.json").read_bytes() == whole
    assert open_study(tmp_path / "whole", request) == scenes
    with pytest.raises(InputError, match="made with other settings"):
        open_study(tmp_path / "whole", SceneRequest("exp1", 3, 3))


STAGES = ("generate_scenes", "generate_practice", "write_chosen", "write_scenes")


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("go_on", [new_study, open_study])
def test_a_new_study_goes_on_after_an_interruption(tmp_path, monkeypatch, stage, go_on):
    request = SceneRequest("exp1", 1, 3, practice=1)
    scenes = draws(EXPERIMENTS.get("exp1").family, 2)
    monkeypatch.setattr(
        folder, "generate_scenes", lambda *_: Selection(scenes[:1], 1, 1, (1, 1, 1))
    )
    monkeypatch.setattr(folder, "generate_practice", lambda *_: scenes[1:])

    def interrupted(*_):
        raise KeyboardInterrupt

    study = tmp_path / "s"
    with monkeypatch.context() as patch:
        patch.setattr(folder, stage, interrupted)
        with pytest.raises(KeyboardInterrupt):
            new_study(study, request)
    (study / ".scenes-0123456789abcdef.json").touch()  # of a process that was killed
    with pytest.raises(InputError, match="not an empty folder"):
        new_study(study, SceneRequest("exp1", 1, 4, practice=1))
    go_on(study, request)
    whole = {"study.toml", "chosen.json", "practice.json", "scenes.json"}
    assert {path.name for path in finished_files(study)} == whole
    assert (load_scenes(study), load_practice(study)) == (scenes[:1], scenes[1:])
    with pytest.raises(InputError, match="not an empty folder"):
        new_study(study, request)


def test_what_somebody_put_into_an_unfinished_study_is_not_written_over(tmp_path):
    request = SceneRequest("exp1", 1, 3)
    (tmp_path / "study.toml").write_text(folder._study_toml(request))
    (tmp_path / "responses.csv").touch()
    with pytest.raises(InputError, match="not an empty folder"):
        new_study(tmp_path, request)


FIRST_DRAWS_OF_0_1 = {
    "exp1-v0": "397a9b374a22",
    "exp2-v0": "b780c2ae092a",
}


@pytest.mark.parametrize("name", FIRST_DRAWS_OF_0_1)
def test_older_experiments_stay_as_they_were(name):
    experiment = EXPERIMENTS.get(name)
    draws = (drawn_scene(experiment.family, 7, k) for k in range(99))
    scene = next(scene for scene in draws if scene is not None)
    assert scene.digest == FIRST_DRAWS_OF_0_1[name]
    # Scenes that belong to no experiment, and plain names of liquids, are of today's.
    assert experiment_like([scene]).name == name.removesuffix("-v0")
    honey = resolve_liquid("honey", scene)
    assert honey.name == f"honey-{name.removesuffix('-v0')}"
    for liquid in experiment.shown_liquids:
        older = resolve_liquid(liquid, scene)
        assert older.cohesion == older.tension == 0.0
        for spec in (experiment.truth(liquid), experiment.observer_model(liquid)):
            assert make_model(spec).liquid in experiment.shown_liquids


@pytest.mark.parametrize(
    "few", [SceneRequest("exp1", 2, quick=True), SceneRequest("exp2", 4, 3, 60, quick=True)]
)
def test_a_study_says_how_its_scenes_were_chosen(tmp_path, monkeypatch, few):
    assert read_chosen(tmp_path) is None
    family, stages = EXPERIMENTS.get(few.experiment).family, few.choice.stages
    scenes, left = draws(family, 9), tuple(range(9, 9 - len(stages), -1))
    figures = {"correlation of the truths": -0.6, "correlation of the models": math.nan}
    selection = Selection(scenes, 9, 9, left, figures)
    monkeypatch.setattr(folder, "generate_scenes", lambda *_: selection)
    new_study(tmp_path / "one", few)
    chosen = read_chosen(tmp_path / "one")
    assert [(one.stage, one.how, one.scenes) for one in chosen.stages] == [
        (*words, count) for words, count in zip(stages, left, strict=True)
    ]
    assert chosen.figures == {**figures, "correlation of the models": None}
    assert chosen.family["name"] == family.name
    assert ("quick" in (tmp_path / "one" / "study.toml").read_text()) == (few.candidates == 60)
    assert open_study(tmp_path / "one", few) == scenes


def test_scenes_that_were_drawn_by_other_rules_are_not_gone_on_with(tmp_path):
    request = SceneRequest("exp1", 2, 3)
    new_study(tmp_path, request)
    chosen, path = read_chosen(tmp_path), tmp_path / "chosen.json"
    others = (
        {"family": {**chosen.family, "cell_count": 7}},
        {"stages": (*chosen.stages[:-1], chosen.stages[-1].model_copy(update={"how": "by hand"}))},
        # What words don't tell, or round.
        {"engine": {**chosen.engine, "damping_scale": 1.0}},
        {"rule": {**chosen.rule, "rule": {**chosen.rule["rule"], "max_stranded": 0.0741}}},
        {"pours": tuple({**pour, "cohesion": 0.01} for pour in chosen.pours)},
        {"rule": {}, "engine": {}, "pours": ()},
    )
    for other in others:
        write_chosen(tmp_path, chosen.model_copy(update=other))
        with pytest.raises(
            InputError, match=r"scenes\.json: drawn by other rules than those of exp1"
        ):
            open_study(tmp_path, request)
    path.unlink()  # pourcast 0.1 kept none
    with pytest.raises(InputError, match="drawn by other rules"):
        open_study(tmp_path, request)
    path.write_text('{"pourcast": "1", "family": {}, "stages": 3}')
    with pytest.raises(InputError, match=r"chosen\.json: stages: "):
        open_study(tmp_path, request)


def test_the_demo_s_scenes_are_such_as_are_drawn_now():
    basins, cup = demo_scenes()
    family, shapes = EXPERIMENTS.get("exp1").family, EXPERIMENTS.get("exp2").family
    heights = [y for obstacle in basins.obstacles for _, y in obstacle]
    assert family.band_bottom <= min(heights) <= max(heights) <= family.band_top
    assert abs(basins.liquid.centre[0] - basins.box.width / 2) <= family.liquid_spread
    assert len(cup.obstacles) == shapes.shape_count
    for obstacle in cup.obstacles:
        circle = shapely.minimum_bounding_radius(shapely.Polygon(obstacle))
        assert shapes.min_radius - 1e-6 <= circle <= shapes.max_radius + 1e-6
