"""A multiverse has all analyses, each of which is what `compare` finds."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pourcast import cli
from pourcast.comparison.agreement import Settings
from pourcast.comparison.compare import compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.comparison.multiverse import FINDINGS, LIKELIHOOD, NO_RULE, study_multiverse
from pourcast.errors import InputError
from pourcast.scenes.scene_file import write_scenes
from pourcast.tables import write_table
from tests.comparison.make import made_up_table, people_like, voronoi_scenes

MODELS = ("gravity", "blobs", "simple:m=0.1")


@pytest.fixture(scope="module")
def scenes():
    return voronoi_scenes(12)


@pytest.fixture
def folder(tmp_path, scenes):
    """Eight people, one of whom hardly moves the slider and one of whom is slow."""
    write_scenes(tmp_path / "scenes.json", scenes)
    write_table(tmp_path / "judgments" / "grid.parquet", made_up_table(scenes))
    rng = np.random.default_rng(3)
    people = people_like(scenes, rng.random(12), people=8)
    wide = pd.DataFrame(people.responses, people.participants, [s.id for s in scenes])
    wide.iloc[0] = 0.5 + 0.01 * rng.random(12)
    wide = wide.rename_axis("participant").reset_index()
    table = wide.melt("participant", var_name="scene", value_name="response")
    slow = table["participant"] == people.participants[1]
    write_responses(tmp_path, table.assign(liquid="water", rt=np.where(slow, 40.0, 4.0)))
    return tmp_path


def write_responses(folder, table):
    write_table(folder / "responses" / "a.csv", table)


def responses_of(folder):
    return pd.read_csv(folder / "responses" / "a.csv")


def options(*rules, models=MODELS):
    return ComparisonOptions(models=models, exclude=rules)


def test_each_rule_is_applied_and_not_with_all_others(folder):
    found = study_multiverse(folder, options("min-sd=0.1", "max-rt=30", "min-trials=2"))
    analyses = found.tables["analyses"]
    sets = [NO_RULE, "min-sd=0.1", "max-rt=30", "min-sd=0.1 + max-rt=30"]
    assert list(analyses["exclusions"].unique()) == sets
    assert len(analyses) == len(sets) * 2 * 3
    assert not analyses.duplicated(["exclusions", "measure", "over"]).any()
    assert analyses.groupby("exclusions")["participants"].first().to_dict() == dict(
        zip(sets, (8, 7, 7, 6), strict=True)
    )
    assert "min-trials=2 takes nothing out that others don't" in found.remarks
    assert set(found.tables["findings"]["finding"]) <= set(FINDINGS)


def test_an_analysis_is_what_compare_finds(folder):
    everything = study_multiverse(folder, options("min-sd=0.1", "max-rt=30"))
    rows = everything.tables["findings"]
    claim = rows["claim"].iloc[0]
    for rules, words in (((), NO_RULE), (("max-rt=30",), "max-rt=30")):
        for over in ("participants", "scenes", "both"):
            asked = replace(options(*rules), settings=Settings(over))
            table = compare_study(folder, asked).tables["differences"]
            own = rows[(rows["exclusions"] == words) & (rows["over"] == over)]
            by_r = own[own["measure"] == "r"].set_index("rival")
            for pair in table.to_dict("records"):
                if claim not in (pair["model"], pair["rival"]):
                    continue
                sign = 1 if pair["model"] == claim else -1
                found = by_r.loc[pair["rival"] if sign == 1 else pair["model"]]
                assert found["difference"] == pytest.approx(sign * pair["difference"])
                assert found["p_holm"] == pytest.approx(pair["p_holm"])
                ends = sorted(sign * pair[end] for end in ("low", "high"))
                assert [found["low"], found["high"]] == pytest.approx(ends)


def test_the_main_analysis_says_what_is_claimed_unless_somebody_does(folder):
    excluded = options("max-rt=30")
    table = compare_study(folder, excluded).tables["agreement"].set_index("model")
    best = table["r"].idxmax()
    assert set(study_multiverse(folder, excluded).tables["findings"]["claim"]) == {best}
    other = table["r"].idxmin()
    found = study_multiverse(folder, excluded, other)
    assert set(found.tables["findings"]["claim"]) == {other}
    assert found.answers[0].startswith(f"water: {other} is nearest to people in ")
    rows = found.tables["findings"].query("measure == 'r'").set_index("rival")
    assert (rows["difference"].loc[[best]] < 0).all()


def test_without_rules_the_usual_ones_that_take_somebody_out_are_tried(folder):
    found = study_multiverse(folder, options())
    assert list(found.tables["analyses"]["exclusions"].unique()) == [NO_RULE, "min-sd=0.05"]
    assert "(min-sd=0.05)" in found.remarks[0]


def test_what_is_not_known_of_few_people_or_scenes_is_left_out_and_said(folder, scenes):
    table = responses_of(folder)
    write_responses(folder, table[table["participant"] == table["participant"].iloc[-1]])
    found = study_multiverse(folder, options())
    assert set(found.tables["analyses"]["over"]) == {"scenes"}
    assert sum("no analysis over" in remark for remark in found.remarks) == 2
    few = table[table["scene"].isin([scene.id for scene in scenes[:3]])]
    write_responses(folder, few)
    assert set(study_multiverse(folder, options()).tables["analyses"]["over"]) == {"participants"}
    write_responses(folder, few[few["participant"].isin(few["participant"].unique()[:2])])
    with pytest.raises(InputError, match="no analysis over"):
        study_multiverse(folder, options())


def test_means_alone_are_analysed_over_scenes(folder):
    table = responses_of(folder).groupby("scene", as_index=False)["response"].mean()
    path = folder / "means.csv"
    table.assign(liquid="water").to_csv(path, index=False)
    asked = replace(options(), responses=path, columns="participant:mean")
    found = study_multiverse(folder, asked)
    assert set(found.tables["analyses"]["over"]) == {"scenes"}
    assert "chance" not in found.tables


def test_answers_that_are_all_0_or_1_are_analysed(folder):
    table = responses_of(folder)
    write_responses(folder, table.assign(response=table["response"].round()))
    found = study_multiverse(folder, options("max-rt=30"))
    assert len(found.tables["analyses"]) == 12


def test_of_answers_that_are_all_the_same_nothing_is_claimed_unless_somebody_does(folder):
    write_responses(folder, responses_of(folder).assign(response=0.5))
    with pytest.raises(InputError, match="nothing is claimed: no model correlates"):
        study_multiverse(folder, options())
    found = study_multiverse(folder, options(), "gravity")
    by = found.tables["findings"].set_index("measure")["finding"]
    assert set(by["r"]) == {"unknown"}
    assert "unknown" not in set(by["rmse"])
    assert " of 1 combinations" in found.answers[0]
    assert found.tables["choices"].set_index("option")["nearest"].isna()["r"]


def test_rules_that_leave_too_few_scenes_are_not_analysed_and_it_is_said(folder, scenes):
    table = responses_of(folder)
    late = ~table["scene"].isin([scene.id for scene in scenes[:2]])
    write_responses(folder, table.assign(rt=np.where(late, 99.0, 4.0)))
    found = study_multiverse(folder, options("max-rt=30", "min-sd=0.1"))
    assert set(found.tables["analyses"]["exclusions"]) == {NO_RULE, "min-sd=0.1"}
    assert sum("2 scenes were answered" in remark for remark in found.remarks) == 2


@pytest.mark.slow
def test_the_likelihood_is_that_of_compare_over_scenes_and_over_participants(folder):
    pytest.importorskip("numpyro")
    asked = replace(options("max-rt=30"), bayes=True)
    found = study_multiverse(folder, asked, "gravity").tables["findings"]
    own = found[(found["measure"] == LIKELIHOOD) & (found["exclusions"] == "max-rt=30")]
    table = compare_study(folder, asked).tables["loo_differences"]
    for unit, rows in own.groupby("over"):
        for row in rows.to_dict("records"):
            pair = table[(table["unit"] == unit) & table["model"].isin(["gravity", row["rival"]])]
            pair = pair[pair["rival"].isin(["gravity", row["rival"]])].iloc[0]
            sign = 1 if pair["model"] == "gravity" else -1
            assert row["difference"] == pytest.approx(sign * pair["difference"])
            assert row["p_holm"] == pytest.approx(pair["p_holm"])
    assert set(own["over"]) == {"scenes", "participants"}


def test_what_cannot_be_asked_is_refused(folder):
    with pytest.raises(InputError, match="claim: there is no 'gravty'; did you mean 'gravity'"):
        study_multiverse(folder, options(), "gravty")
    with pytest.raises(InputError, match="6 rules, expected at most 5"):
        study_multiverse(folder, options(*(f"min-trials={k}" for k in range(6))))
    with pytest.raises(InputError, match="two"):
        study_multiverse(folder, options(models=("gravity",)))
    with pytest.raises(InputError, match="min-sdd"):
        study_multiverse(folder, options("min-sdd=2"))


def test_fitted_models_alone_are_compared_by_r_alone(folder):
    fitted = ("water-ife:fitted", "water-simple:fitted")
    found = study_multiverse(folder, options("max-rt=30", models=fitted))
    assert set(found.tables["analyses"]["measure"]) == {"r"}
    assert any("not compared by RMSE" in remark for remark in found.remarks)
    beside = study_multiverse(folder, options("max-rt=30", models=(*fitted, "gravity", "blobs")))
    by_rmse = beside.tables["findings"].query("measure == 'rmse'")
    assert not by_rmse["rival"].str.endswith(":fitted").any()


def test_rules_that_touch_one_liquid_are_no_analyses_of_another(folder):
    table = responses_of(folder)
    other = table[table["participant"] != table["participant"].iloc[1]].assign(rt=4.0)
    write_responses(folder, pd.concat([table, other.assign(liquid="honey")]))
    found = study_multiverse(folder, options("max-rt=30"))
    counts = found.tables["analyses"].groupby("liquid")["exclusions"].unique().map(list).to_dict()
    assert counts == {"water": [NO_RULE, "max-rt=30"], "honey-exp1": [NO_RULE]}
    assert "max-rt=30" not in set(found.tables["choices"].query("liquid == 'honey-exp1'")["choice"])
    # A rule may leave nobody for one of them.
    write_responses(folder, pd.concat([table, other.assign(liquid="honey", rt=99.0)]))
    found = study_multiverse(folder, options("max-rt=50"))
    assert "honey-exp1: not analysed: excluded: max-rt=50 (nobody is left)" in found.remarks


def test_equal_models_are_both_nearest(folder):
    found = study_multiverse(
        folder, options("max-rt=30", models=("gravity", "gravity:", "blobs")), "gravity:"
    )
    rows = found.tables["findings"].query("rival == 'gravity'")
    assert set(rows["finding"]) == {"nearer"}
    assert (rows["p"] == 1.0).all()
    first = study_multiverse(
        folder, options("max-rt=30", models=("gravity", "gravity:", "blobs")), "gravity"
    )
    nearest = [each.tables["analyses"]["nearest"].tolist() for each in (found, first)]
    assert nearest[0] == nearest[1]


def test_the_command_says_whether_it_stands_and_draws_it(folder, capsys):
    out = folder / "multiverse"
    rules = ["--exclude", "max-rt=30", "--exclude", "min-sd=0.1"]
    models = [part for model in MODELS for part in ("-m", model)]
    assert cli.run(["multiverse", str(folder), *models, *rules, "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert " of 8 combinations of exclusions and measure. In 24 analyses" in said
    assert "max-rt=30" in said
    names = {file.name for file in out.iterdir()}
    assert {"multiverse.svg", "multiverse.png", "findings.csv", "choices.csv"} <= names
    assert cli.run(["multiverse", str(folder), *models, *rules, "--json"]) == 0
    first = capsys.readouterr().out
    assert len(json.loads(first)["tables"]["findings"]) == 24 * 2
    assert cli.run(["multiverse", str(folder), *models, *rules, "--json"]) == 0
    assert capsys.readouterr().out == first
