import numpy as np
import pytest

from pourcast.comparison import choice
from pourcast.comparison.agreement import (
    PeopleAndModels,
    Settings,
    agreement_table,
    differences_table,
    individuals,
    intervals_table,
    people_table,
    reliability_table,
)
from pourcast.comparison.answer import answers
from pourcast.comparison.candidates import candidates
from pourcast.comparison.design import Design, power_table
from pourcast.comparison.window import variance_table, variance_tests, window_variances
from pourcast.statistics.jackknife import over_words
from pourcast.statistics.observer import Population
from tests.comparison.make import made_up, people_like, voronoi_scenes

SETTINGS = Settings()


def compared(people=20, scenes=40, seed=0, noise=0.15):
    rng = np.random.default_rng(seed)
    shown, right = voronoi_scenes(scenes), rng.random(scenes)
    models = {
        "right": right,
        "near": np.clip(right + 0.15 * rng.standard_normal(scenes), 0, 1),
        "wrong": rng.random(scenes),
        "truth-water": np.clip(right + 0.3 * rng.standard_normal(scenes), 0, 1),
    }
    return PeopleAndModels(people_like(shown, right, people, noise, seed), models)


def test_agreement_is_numpy_s_and_every_interval_says_what_it_is_over():
    one = compared()
    table = agreement_table(one, SETTINGS).set_index("model")
    means = one.trials.responses.mean(axis=0)
    for name, judgments in one.models.items():
        assert table.loc[name, "r"] == pytest.approx(np.corrcoef(means, judgments)[0, 1])
        assert table.loc[name, "r_truth_water"] == pytest.approx(
            np.corrcoef(judgments, one.models["truth-water"])[0, 1]
        )
    assert (table["over"] == "both").all()
    for measure in ("r", "rmse", "bias", "slope", "explained"):
        assert (table[f"{measure}_low"] < table[f"{measure}_high"]).all()
    assert table.loc["right", "explained"] == pytest.approx(1.0, abs=0.1)


def test_bias_and_slope_tell_what_r_does_not():
    one = compared(noise=0.01)
    shy = PeopleAndModels(
        one.trials,
        {"bold": np.clip(2 * one.models["right"] - 0.5, -1, 2), "high": one.models["right"] + 0.2},
    )
    table = agreement_table(shy, SETTINGS).set_index("model")
    assert (table["r"] > 0.99).all()
    assert table.loc["bold", "slope"] == pytest.approx(0.5, abs=0.02)
    assert table.loc["high", "bias"] == pytest.approx(-0.2, abs=0.02)


def test_intervals_over_three_things():
    table = intervals_table(compared(), SETTINGS)
    widths = (table["high"] - table["low"]).groupby(table["over"]).mean()
    assert set(widths.index) == {"participants", "scenes", "both"}
    assert widths["both"] > widths["participants"]


def test_who_beats_whom():
    one = compared()
    table = differences_table(one, SETTINGS).set_index(["model", "rival"])
    assert len(table) == 6
    assert table.loc[("right", "wrong"), "difference"] > 0.5
    assert table.loc[("right", "wrong"), "p_holm"] < 0.05
    assert table.loc[("right", "wrong"), "low"] > 0
    assert (table["p_holm"] >= table["p"] - 1e-12).all()
    twins = PeopleAndModels(one.trials, {"a": one.models["right"], "b": one.models["right"]})
    same = differences_table(twins, SETTINGS).iloc[0]
    assert same["difference"] == same["low"] == same["high"] == 0
    assert same["p"] == 1


def test_paired_intervals_are_narrower_than_the_models_own():
    one = compared(noise=0.4)
    table = differences_table(one, Settings("both")).set_index(["model", "rival"])
    own = agreement_table(one, Settings("both")).set_index("model")
    paired = table.loc[("right", "near")]
    apart = (
        own.loc["right", "r_high"]
        - own.loc["right", "r_low"]
        + own.loc["near", "r_high"]
        - own.loc["near", "r_low"]
    )
    assert paired["high"] - paired["low"] < 0.9 * apart


def test_a_model_without_spread_has_no_r_and_stops_nothing():
    one = compared()
    flat = PeopleAndModels(one.trials, dict(one.models) | {"flat": np.full(40, 0.5)})
    table = agreement_table(flat, SETTINGS).set_index("model")
    assert np.isnan(table.loc["flat", "r"])
    assert np.isfinite(table.loc["flat", "rmse"])
    pairs = differences_table(flat, SETTINGS)
    assert pairs["p_holm"].notna().sum() == 6


def test_reliability_needs_four_participants():
    three, many = compared(people=3).trials, compared(people=20).trials
    table = reliability_table([many, three], SETTINGS)
    assert np.isnan(table["split_half"].iloc[1])
    row = table.iloc[0]
    assert row["split_half_low"] < row["split_half"] < row["split_half_high"]
    assert row["split_half"] < row["spearman_brown"] < 1
    assert row["ceiling"] == pytest.approx(np.sqrt(row["reliability"]))


def test_individuals():
    one = compared()
    lazy = one.trials.responses.copy()
    lazy[3] = 0.5
    trials = type(one.trials)(one.trials.liquid, one.trials.participants, one.trials.scenes, lazy)
    found = individuals([PeopleAndModels(trials, one.models)], SETTINGS)
    assert np.isnan(found.table["r"].iloc[3])
    summary = found.summary().iloc[0]
    assert summary["participants"] == 19
    assert summary["beat_chance"] >= 17
    assert summary["ks_p"] < 1e-6
    nothing = individuals([PeopleAndModels(trials, {"right": one.models["right"]})], SETTINGS)
    assert nothing.table.empty
    assert nothing.summary().empty


def test_scene_by_scene():
    one = compared()
    table = people_table([one])
    assert table["mean"].to_numpy() == pytest.approx(one.trials.responses.mean(axis=0))
    assert table["near"].to_numpy() == pytest.approx(one.models["near"])


def interval_widths(level):
    """Name -> widths of every interval that a comparison makes."""
    settings = Settings(level=level)
    scenes, judged = made_up(20)
    people = PeopleAndModels(
        people_like(scenes, judged.judgments[0], noise=0.2),
        {"water-ife": judged.judgments[3], "other": judged.judgments[40]},
    )
    sets = candidates(judged, [people.trials])
    chosen = choice.choice_table(sets, settings)
    carried = type(people)(people.trials, dict.fromkeys(chosen["spec"], judged.judgments[3]))
    tables = {
        "agreement": agreement_table(people, settings),
        "intervals": intervals_table(people, settings),
        "differences": differences_table(people, settings),
        "reliability": reliability_table([people.trials], settings),
        "choice": chosen,
        "cross-validation": choice.cross_validation_table(sets, settings, halvings=200),
        "carried": choice.carried_table([carried], chosen, settings),
        "variance": variance_table(window_variances(judged, "water", settings)),
        "power": power_table(
            Design.of(people, {}), *people.names[:2], observers=[3, 9], scenes=[10], studies=8,
            population=Population(), settings=settings,
        ),
    }  # fmt: skip
    return {
        f"{name} {high}": (table[high] - table[high.replace("high", "low")]).to_numpy()
        for name, table in tables.items()
        for high in table.columns
        if high.endswith("high")
    }


def test_every_interval_has_the_level_that_was_asked_for():
    wide, narrow = interval_widths(0.95), interval_widths(0.5)
    assert len(wide) >= 15
    for name, widths in wide.items():
        assert (narrow[name] < 0.7 * widths).all(), name


def test_who_beats_chance_depends_on_the_level():
    one = compared(noise=0.5)
    beat = [
        individuals([one], Settings(level=level)).summary()["beat_chance"].iloc[0]
        for level in (0.5, 0.95)
    ]
    assert beat[0] > beat[1]


def test_same_seed_same_table():
    one = compared()
    assert agreement_table(one, SETTINGS).equals(agreement_table(one, SETTINGS))
    assert reliability_table([one.trials], SETTINGS).equals(
        reliability_table([one.trials], SETTINGS)
    )


def test_variance_over_the_windows():
    _, judged = made_up(20)
    found = window_variances(judged, "water", SETTINGS)
    assert list(found) == ["water-ife", "honey-ife-1", "honey-ife-2"]
    rows = [
        judged.find("water", f"ife:liquid=water,damping_zeta={z},zeta_sigma=0")
        for z in range(1, 10)
    ]
    assert found["water-ife"].mean == pytest.approx(np.var(rows, axis=0, ddof=1).mean())
    table = variance_table(found)
    assert ((table["low"] < table["variance"]) & (table["variance"] < table["high"])).all()
    assert len(variance_tests(found)) == 3
    assert (
        window_variances(
            type(judged)(judged.scenes, judged.rows.iloc[:0], judged.judgments[:0]),
            "water",
            SETTINGS,
        )
        == {}
    )


def test_the_answer_says_how_models_were_tested_or_why_not():
    one = compared()
    tables = {
        "agreement": agreement_table(one, SETTINGS), "differences": differences_table(one, SETTINGS)
    }  # fmt: skip
    assert answers(tables)[0].endswith("; p < .05, Holm.)")
    untested = tables | {"differences": tables["differences"].assign(p_holm=np.nan)}
    assert answers(untested)[0].endswith("(Nothing was tested: a note says why.)")
    # One model alone has nothing to be tested against, and its interval holds over something.
    alone = {"agreement": tables["agreement"].head(1)}
    assert answers(alone)[0].endswith(f"(Over {over_words(SETTINGS.over)}.)")
