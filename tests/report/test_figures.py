import re

import numpy as np
import pandas as pd
import pytest

from pourcast.comparison.agreement import agreement_table, differences_table, individuals
from pourcast.comparison.candidates import candidates
from pourcast.comparison.choice import choice_table, scores_table
from pourcast.pictures.style import save_figure
from pourcast.report.figures import design, fits, models, people, scenes
from pourcast.scenes.goals.cup import Cup
from pourcast.study.experiments.base import published_with_people
from pourcast.study.experiments.registry import EXPERIMENTS
from tests.comparison.make import made_up, people_like, voronoi_scenes
from tests.comparison.test_agreement import SETTINGS, compared

PUBLISHED = published_with_people(EXPERIMENTS.get("exp1"), "water")


def bars(axes):
    return [patch.get_width() for patch in axes.patches]


def test_correlations_are_bars_with_published_diamonds():
    table = agreement_table(compared(), SETTINGS)
    table.loc[table["model"] == "right", "model"] = "water-ife"
    figure = models.correlations(table, EXPERIMENTS.get("exp1"))
    assert bars(figure.axes[0]) == pytest.approx(table["r"].tolist())
    diamonds = next(line for line in figure.axes[0].lines if line.get_marker() == "D")
    assert sorted(diamonds.get_xdata()) == sorted(
        [PUBLISHED["water-ife"].r, PUBLISHED["truth-water"].r]
    )
    assert not models.correlations(table, EXPERIMENTS.get("exp2")).axes[0].lines


def test_published_values_are_within_their_intervals():
    for name in EXPERIMENTS.names():
        published = EXPERIMENTS.get(name).published
        tables = published.with_people.values() if published else ()
        assert all(one.low <= one.r <= one.high for table in tables for one in table.values())
    assert published_with_people(EXPERIMENTS.get("exp1"), "honey")["gravity"].r == 0.73
    assert len(published_with_people(EXPERIMENTS.get("exp2"), "water")) == 0


def test_scatter_shows_every_scene():
    one = compared()
    figure = models.scatter(one, ["right", "wrong"])
    dots = figure.axes[0].lines[1]
    assert dots.get_xdata() == pytest.approx(one.models["right"])
    assert dots.get_ydata() == pytest.approx(one.trials.responses.mean(axis=0))


def test_people_s_answers_stand_beside_those_of_the_models():
    tenths = pd.DataFrame(
        {
            "model": np.repeat(["a", "b:n=1"], 10), "above": np.tile(np.arange(10) / 10, 2),
            "below": np.tile(np.arange(1, 11) / 10, 2), "observed": [0.55, *[0.05] * 9] * 2,
            "mean": 0.1, "low": 0.08, "high": 0.12,
        }
    )  # fmt: skip
    figure = models.answers_by_tenths(tenths)
    assert [axes.get_title() for axes in figure.axes] == ["a", "b:\nn=1"]
    for axes in figure.axes:
        (people, *_), (high, _, low), (mean, *_) = (one.get_data() for one in axes.patches)
        assert people.tolist() == [0.55, *[0.05] * 9]
        assert (high == 0.12).all()
        assert (low == 0.08).all()
        assert (mean == 0.1).all()
        assert axes.get_ylim()[0] == 0.0
        assert axes.get_ylim()[1] > 0.55


def test_the_best_of_each_family_comes_first():
    assert models.best_of_each_family(compared(), 3)[0] == "right"


def test_difference_matrix_is_antisymmetric():
    table = differences_table(compared(), SETTINGS)
    matrix = models.differences(table, "water").axes[0].images[0].get_array().filled(0)
    assert np.nan_to_num(matrix) == pytest.approx(-np.nan_to_num(matrix).T)
    assert matrix[0, 1] == pytest.approx(table["difference"].iloc[0])


def test_heat_map_and_profiles_show_the_scores():
    shown, judged = made_up(20)
    trials = [
        people_like(shown, judged.find("water", "ife:liquid=water,damping_zeta=5,zeta_sigma=4"))
    ]
    sets = candidates(judged, trials)
    scores, choice = scores_table(sets), choice_table(sets, SETTINGS)
    heat = fits.alpha_zeta(scores).axes[0].images[0].get_array()
    assert heat.shape == (3, 17)
    rows = scores[(scores["model"] == "water-ife") & (scores["n_particles"] == 50)]
    own = rows[rows["viscosity_alpha"] == "own"].sort_values("damping_zeta")["r"]
    assert np.asarray(heat[0]) == pytest.approx(own.to_numpy())
    line = fits.zeta_profiles(scores, choice).axes[0].lines[0]
    assert len(line.get_xdata()) == 17


def test_profiles_of_other_models_are_the_best_at_each_value():
    scores = pd.DataFrame(
        {"model": "rival", "liquid": "water", "blur": [0.1, 0.1, 0.2, 0.2], "r": [0.1, 0.5, 0.3, 0.2],
         "imagined": ["oil", "water", "oil", "water"]}
    )  # fmt: skip
    choice = pd.DataFrame(
        {"model": ["rival"], "liquid": "water", "fitted": "blur, liquid", "blur": 0.1,
         "imagined": "water"}
    )  # fmt: skip
    blur, imagined = fits.profiles(scores, choice).axes
    assert blur.lines[0].get_ydata().tolist() == [0.5, 0.3]
    assert imagined.lines[0].get_ydata().tolist() == [0.3, 0.5]
    assert blur.lines[1].get_ydata().tolist() == imagined.lines[1].get_ydata().tolist() == [0.5]


def test_participants_against_null():
    found = individuals([compared()], SETTINGS)
    figure = people.against_null(found)
    assert sum(patch.get_height() for patch in figure.axes[0].patches) == pytest.approx(2.0)


def test_recovery_and_power():
    shares = pd.DataFrame(
        np.eye(3), columns=["a", "b", "c"], index=pd.Index(["a", "b", "c"], name="planted")
    )
    assert (
        np.asarray(design.recovery(shares, "t").axes[0].images[0].get_array()).tolist()
        == np.eye(3).tolist()
    )
    zetas = pd.DataFrame(np.eye(17)).assign(within_one_step=1.0)
    assert design.recovery(zetas, "t").axes[0].images[0].get_array().shape == (17, 17)
    power = pd.DataFrame(
        {
            "observers": [5, 10],
            "scenes": [12, 12],
            "power": [0.2, 0.6],
            "low": [0.1, 0.5],
            "high": [0.3, 0.7],
        }
    )
    line = design.power(power, "t").axes[0].lines[0]
    assert line.get_ydata().tolist() == [0.2, 0.6]


def test_pictures_of_scenes():
    found = voronoi_scenes(7)
    assert len(scenes.stimuli(found).axes) == 5
    cup = found[0].model_copy(update={"goal": Cup()})
    assert len(scenes.heuristics(cup).axes) == 5
    figure = scenes.particle_engine(found[0])
    assert figure.axes[0].lines[0].get_ydata()[-1] == 0
    assert [len(axes.lines[0].get_xdata()) for axes in figure.axes[1:]] == [15, 50, 100, 200, 50]


def test_simulated_figures_say_so_and_the_same_figure_has_the_same_bytes(tmp_path):
    for simulated in (True, False):
        found = [
            save_figure(
                models.scatter(compared(), ["right"]), tmp_path / f"{k}", simulated=simulated
            )
            for k in range(2)
        ]
        for one, other in zip(*found, strict=True):
            assert one.read_bytes() == other.read_bytes()
        text = found[0][0].read_text()
        assert ("simulated observers" in text) == simulated
    assert re.search(r"<text", text)


def test_models_in_heads_are_stacked_to_one():
    table = pd.DataFrame(
        {"liquid": ["water", "water", "honey"], "participant": list("abc"),
         "model": ["one", "other", "own"], "probability": [0.9, 0.6, 1.0],
         "p_one": [0.9, 0.4, np.nan], "p_other": [0.1, 0.6, np.nan], "p_own": [np.nan, np.nan, 1.0]}
    )  # fmt: skip
    figure = people.heads(table)
    for axes, count in zip(figure.axes, (2, 1), strict=True):
        assert sum(patch.get_height() for patch in axes.patches) == pytest.approx(count)
    assert [text.get_text() for text in figure.legends[0].texts] == ["one", "other", "own"]
