import numpy as np
import pandas as pd
import pytest

from pourcast.errors import InputError
from pourcast.scenes.goals.cup import Cup
from pourcast.study.responses import exclude, read_responses
from pourcast.study.scale import PERCENT, scale_of
from pourcast.study.trials import arrange, remarks, repeats, uncompared
from tests.make import ramp_scene


def scenes(count=3):
    return [
        ramp_scene().model_copy(
            update={
                "id": f"s{k}",
                "liquid": ramp_scene().liquid.model_copy(update={"centre": (0.4, 1.3 + 0.001 * k)}),
            }
        )
        for k in range(count)
    ]


def good(people=5, count=3):
    rng = np.random.default_rng(0)
    rows = [
        {
            "participant": f"p{p}",
            "scene": f"s{s}",
            "liquid": "water",
            "response": round(rng.random(), 3),
            "rt": 2.0,
        }
        for p in range(people)
        for s in range(count)
    ]
    return pd.DataFrame(rows)


def written(tmp_path, table, name="r.csv"):
    path = tmp_path / name
    table.to_csv(path, index=False) if path.suffix == ".csv" else table.to_parquet(
        path, index=False
    )
    return path


def test_good_table_becomes_an_array(tmp_path):
    table = good()
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "r.csv")
    assert [one.liquid for one in found] == ["water"]
    assert found[0].participants == ("p0", "p1", "p2", "p3", "p4")
    assert found[0].responses == pytest.approx(table["response"].to_numpy().reshape(5, 3))
    assert remarks(found, scenes()) == []


def test_csv_and_parquet_say_the_same(tmp_path):
    one, two = (
        read_responses(written(tmp_path, good(), name), scenes()) for name in ("r.csv", "r.parquet")
    )
    assert (
        arrange(one, scenes(), "").pop().responses == arrange(two, scenes(), "").pop().responses
    ).all()


def test_honey_is_that_of_the_scene_s_experiment(tmp_path):
    cups = [scene.model_copy(update={"goal": Cup(centre_x=0.5)}) for scene in scenes()]
    path = written(tmp_path, good().assign(liquid="honey"))
    assert set(read_responses(path, scenes())["liquid"]) == {"honey-exp1"}
    assert set(read_responses(path, cups)["liquid"]) == {"honey-exp2"}


def test_numbers_as_names_and_rows_in_any_order(tmp_path):
    table = (
        good().assign(participant=lambda t: t["participant"].str[1:]).sample(frac=1, random_state=0)
    )
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "")
    assert found[0].participants == ("0", "1", "2", "3", "4")
    assert found[0].responses == pytest.approx(good()["response"].to_numpy().reshape(5, 3))


def test_blank_lines_are_no_rows_but_count(tmp_path):
    path = tmp_path / "r.csv"
    lines = good().to_csv(index=False).splitlines()
    path.write_text("\n".join([*lines[:3], "", *lines[3:], "", ""]))
    found = arrange(read_responses(path, scenes()), scenes(), "")
    assert found[0].responses == pytest.approx(good()["response"].to_numpy().reshape(5, 3))
    path.write_text(path.read_text().replace(lines[5], lines[5].replace("s1", "s9")))
    with pytest.raises(InputError, match="row 7, column scene"):
        read_responses(path, scenes())


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("response", 1.2, r"row 9, column response: expected 0..1 \(.*\), found 1.2"),
        ("response", -0.1, r"row 9, column response: expected 0..1 \(.*\), found -0.1"),
        (
            "response",
            63,
            r"expected 0..1 \(on another scale\? say which, such as --scale 0-100\), found 63",
        ),
        ("response", "left", "row 9, column response: expected a number, found 'left'"),
        ("participant", None, "row 9, column participant: expected a name"),
        ("scene", "s9", "row 9, column scene: expected a scene of the study .*did you mean 's"),
        ("liquid", "oil", "row 9, column liquid: there is no 'oil'"),
        ("rt", "fast", "row 9, column rt: expected a number, found 'fast'"),
    ],
)
def test_a_bad_cell_is_named_by_row_and_column(tmp_path, column, value, said):
    table = good().astype(object)
    table.loc[7, column] = value
    path = written(tmp_path, table)
    with pytest.raises(InputError, match=said) as error:
        read_responses(path, scenes())
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_percent(tmp_path):
    table = good().assign(response=lambda t: 100 * t["response"])
    path = written(tmp_path, table)
    with pytest.raises(InputError, match=r"--scale 0-100.*more rows"):
        read_responses(path, scenes())
    found = arrange(read_responses(path, scenes(), scale=PERCENT), scenes(), "")
    assert found[0].responses == pytest.approx(good()["response"].to_numpy().reshape(5, 3))
    bad = written(tmp_path, table.assign(response=lambda t: t["response"] + 50))
    with pytest.raises(InputError, match=r"expected 0\.\.100, found 1"):
        read_responses(bad, scenes(), scale=PERCENT)


# As programs and spreadsheets write tables -------------------------------------------------


WAYS = {
    "decimal commas": lambda t: t.to_csv(index=False, sep=";", decimal=",").encode(),
    "semicolons": lambda t: t.to_csv(index=False, sep=";").encode(),
    "UTF-16 with tabs": lambda t: t.to_csv(index=False, sep="\t").encode("utf-16"),
    "byte-order mark": lambda t: t.to_csv(index=False).encode("utf-8-sig"),
    "Windows-1252": lambda t: t.assign(remark="caf\u00e9").to_csv(index=False).encode("cp1252"),
    "percent signs": lambda t: (
        t.assign(response=[f"{100 * r:.9f}%" for r in t["response"]]).to_csv(index=False).encode()
    ),
    "quoted commas": lambda t: t.rename(columns={"rt": "rt, in s"}).to_csv(index=False).encode(),
    "phase with a capital": lambda t: t.assign(phase="Test ").to_csv(index=False).encode(),
}


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ("decimal commas", "separated by semicolons, with decimal commas"),
        ("semicolons", "separated by semicolons"),
        ("UTF-16 with tabs", "UTF-16, separated by tabs"),
        ("byte-order mark", ""),
        ("Windows-1252", "Windows-1252"),
        ("percent signs", ""),
        ("quoted commas", ""),
        ("phase with a capital", ""),
    ],
)
def test_a_table_is_read_however_it_is_written_and_that_is_told(tmp_path, how, told):
    path = tmp_path / "r.csv"
    path.write_bytes(WAYS[how](good()))
    table = read_responses(path, scenes())
    assert " ".join(table.attrs["told"]) == (told and f"r.csv: read as {told}")
    found = arrange(table, scenes(), "")
    assert found[0].responses == pytest.approx(good()["response"].to_numpy().reshape(5, 3))


def test_names_that_look_like_nothing_are_names(tmp_path):
    names = {f"p{k}": name for k, name in enumerate(["NA", "nan", "None", "007", "null"])}
    table = good().assign(participant=lambda t: t["participant"].map(names))
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "")
    assert set(found[0].participants) == set(names.values())


def test_one_name_in_two_forms_of_unicode_is_one_person(tmp_path):
    table = good().astype({"participant": object})
    rows = table["participant"] == "p0"
    table.loc[rows, "participant"] = ["Jos\u00e9", "Jose\u0301", "Jos\u00e9"]
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "")
    assert len(found[0].participants) == 5


@pytest.mark.parametrize("blank", [None, "NA", "nan"])
def test_a_blank_response_is_missing_and_counted(tmp_path, blank):
    table = good().astype({"response": object})
    table.loc[7, "response"] = blank
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "")
    assert np.isnan(found[0].responses).sum() == 1
    assert any("p2 (1)" in line for line in remarks(found, scenes()))


def test_who_gave_no_answer_at_all_is_no_participant_but_is_told_of(tmp_path):
    table = good()
    table.loc[table["participant"] == "p1", "response"] = np.nan
    read = read_responses(written(tmp_path, table), scenes())
    assert arrange(read, scenes(), "")[0].participants == ("p0", "p2", "p3", "p4")
    assert uncompared(read) == [
        "3 test trials have no response: they count as missing",
        "without any response, and so no participants: p1",
    ]
    table["response"] = np.nan
    with pytest.raises(InputError, match="no response"):
        arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "r.csv")


@pytest.mark.parametrize(("low", "high"), [(0, 10), (-1, 1), (0, 100), (1, 7)])
def test_any_scale_is_taken_if_it_is_said(tmp_path, low, high):
    table = good().assign(response=lambda t: low + (high - low) * t["response"])
    scale = scale_of(f"{low}..{high}")
    found = arrange(read_responses(written(tmp_path, table), scenes(), scale=scale), scenes(), "")
    assert found[0].responses == pytest.approx(good()["response"].to_numpy().reshape(5, 3))


def test_who_seems_to_have_answered_on_another_scale_is_told(tmp_path):
    table = good().assign(response=lambda t: 100.0 * t["response"])
    some = table["participant"].isin(["p1", "p4"])
    table["response"] = table["response"].where(~some, table["response"] / 100.0)
    told = read_responses(written(tmp_path, table), scenes(), scale=PERCENT).attrs["told"]
    assert told[-1].endswith("as if answered in 0..1, by p1, p4")
    # Who answers 0 and 1 of 100, and nothing in between, may mean it.
    table["response"] = table["response"].where(~some, table["response"].round())
    told = read_responses(written(tmp_path, table), scenes(), scale=PERCENT).attrs["told"]
    assert len(told) == 1


def test_a_scale_that_does_not_fit_is_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"expected 0\.\.100, found nothing above 0\.\d+: are these"
    ):
        read_responses(written(tmp_path, good()), scenes(), scale=PERCENT)
    mixed = good().astype({"response": object})
    mixed.loc[3, "response"] = "63%"
    with pytest.raises(InputError, match="expected a percent sign, as in other rows"):
        read_responses(written(tmp_path, mixed), scenes())
    for text in ("0", "100-0", "a-b", ""):
        with pytest.raises(InputError, match="scale: expected LOW-HIGH"):
            scale_of(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("participant,scene,response\np,s0,0.5\n", "column 'liquid' is missing; expected"),
        ("participant,scene,liquid,response\n", "no rows"),
        ("", "not a table"),
        ("a,b\n1,2,3\n4\n5,6,7,8\n", "not a table|is missing"),
    ],
)
def test_not_a_table_of_responses(tmp_path, text, said):
    path = tmp_path / "r.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_responses(path, scenes())


def test_no_file_and_a_wrong_one(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_responses(tmp_path / "none.csv", scenes())
    with pytest.raises(InputError, match=r"expected a \.csv, \.tsv, \.txt or \.parquet"):
        read_responses(tmp_path / "r.xlsx", scenes())


def test_repeated_trials_are_averaged_and_that_is_told(tmp_path):
    table = pd.concat([good(), good().iloc[[4]].assign(response=0.9)])
    read = read_responses(written(tmp_path, table), scenes())
    first = good()["response"].iloc[4]
    (trials,) = arrange(read, scenes(), "r.csv")
    assert trials.responses[1, 1] == pytest.approx((first + 0.9) / 2)
    assert trials.occasions.shape == (2, 5, 3)
    assert trials.occasions[:, 1, 1] == pytest.approx([first, 0.9])
    assert np.isfinite(trials.occasions[1]).sum() == 1
    assert repeats(read) == [
        "1 trials of 1 participants repeat a scene with its liquid: their answers are averaged "
        "(--exclude repeats=first keeps the first)"
    ]
    kept, what = exclude(read, ["repeats=last"])
    assert what[0].trials == 1
    assert repeats(kept) == []
    (trials,) = arrange(kept, scenes(), "")
    assert trials.responses[1, 1] == 0.9
    assert trials.occasions is None


def test_a_repeat_in_the_mirror_is_turned_back_first(tmp_path):
    twice = [good().assign(mirrored=False), good().assign(mirrored=True)]
    twice[1]["response"] = 1 - twice[1]["response"]
    read = read_responses(written(tmp_path, pd.concat(twice)), scenes())
    (trials,) = arrange(read, scenes(), "")
    assert trials.responses == pytest.approx(good()["response"].to_numpy().reshape(5, 3))
    assert trials.occasions[0] == pytest.approx(trials.occasions[1])


@pytest.mark.parametrize("column", ["rt", "trial"])
def test_a_row_that_was_pasted_twice_counts_once_and_is_told(tmp_path, column):
    numbers = 1 + 0.5 * np.arange(15)
    table = good().drop(columns="rt").assign(**{column: numbers})
    again = table.iloc[[4]].assign(response=0.9, **{column: 99})
    read = read_responses(
        written(tmp_path, pd.concat([table, table.iloc[[4, 5]], again])), scenes()
    )
    (trials,) = arrange(read, scenes(), "")
    assert trials.occasions.shape == (2, 5, 3)
    assert trials.responses[1, 1] == pytest.approx((table["response"].iloc[4] + 0.9) / 2)
    copies, averaged = repeats(read)
    assert copies.startswith("2 rows are copies of others, with the same trial number")
    assert copies.endswith("(row 17 (and 1 more row: 18))")
    assert averaged.startswith("1 trials of 1 participants")


def test_the_same_answer_in_another_block_is_no_copy(tmp_path):
    table = good().drop(columns="rt").assign(trial=range(15))
    blocks = pd.concat([table.assign(block=1), table.assign(block=2)])
    read = read_responses(written(tmp_path, blocks), scenes())
    assert arrange(read, scenes(), "")[0].occasions.shape == (2, 5, 3)
    assert len(repeats(read)) == 1


def test_the_same_answer_again_is_no_copy_where_nothing_tells(tmp_path):
    table = pd.concat([good().drop(columns="rt")] * 2)
    read = read_responses(written(tmp_path, table), scenes())
    assert np.isfinite(arrange(read, scenes(), "")[0].occasions).all()


def test_gaps_constant_answers_and_empty_scenes_are_told(tmp_path):
    table = good()
    table.loc[table["participant"] == "p2", "response"] = 0.5
    table = table[
        (table["scene"] != "s2") & ~((table["participant"] == "p3") & (table["scene"] == "s1"))
    ]
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "")
    told = " | ".join(remarks(found, scenes()))
    assert "nobody answered 1 scenes: s2" in told
    assert "p3 (1)" in told
    assert "always the same answer: p2, p3" in told
    assert np.isnan(found[0].responses[3, 1])


def test_other_phases_are_not_compared(tmp_path):
    practice = good().assign(phase="practice", scene="somewhere else", response=0.1)
    table = pd.concat([good().assign(phase="test"), practice])
    found = arrange(read_responses(written(tmp_path, table), scenes()), scenes(), "")
    assert found[0].responses.shape == (5, 3)


def test_mirrored_trials_are_turned_back(tmp_path):
    path = written(tmp_path, good().assign(mirrored=True))
    plain = good()["response"].to_numpy().reshape(5, 3)
    assert arrange(read_responses(path, scenes()), scenes(), "")[0].responses == pytest.approx(
        1 - plain
    )
    cups = [scene.model_copy(update={"goal": Cup(centre_x=0.5)}) for scene in scenes()]
    assert arrange(read_responses(path, cups), cups, "")[0].responses == pytest.approx(plain)


def test_rules(tmp_path):
    table = good()
    table.loc[table["participant"] == "p2", "response"] = 0.5
    table.loc[0, "rt"] = 90.0
    checks = pd.DataFrame(
        {"participant": ["p0", "p1", "p3", "p4"], "correct": [True, False, True, True]}
    )
    checks = checks.assign(scene="check", liquid="water", phase="attention", response=np.nan)
    table = pd.concat([table.assign(phase="test"), checks])
    read = read_responses(written(tmp_path, table), scenes())
    left, told = exclude(
        read, ["min-sd=0.01", "max-rt=60", "min-attention=1", "participant=p4", "min-trials=3"]
    )
    assert [(one.rule, one.participants, one.trials) for one in told] == [
        ("min-sd=0.01", ("p2",), 3),
        ("max-rt=60", (), 1),
        ("min-attention=1", ("p1",), 3),
        ("participant=p4", ("p4",), 3),
        ("min-trials=3", ("p0",), 2),
    ]
    assert set(left["participant"]) == {"p3"}


@pytest.mark.parametrize(
    ("rule", "said"),
    [
        ("min-std=1", "there is no 'min-std'; did you mean 'min-sd'"),
        ("min-sd", "expected min-sd=VALUE"),
        ("min-sd=much", "expected a number, found 'much'"),
        ("participant=p9", "there is no such participant"),
        ("repeats=middle", "expected first or last"),
        ("min-attention=1", "needs rows of the phase 'attention'"),
        ("min-sd=2", "no test trials are left"),
    ],
)
def test_bad_rules(tmp_path, rule, said):
    read = read_responses(written(tmp_path, good()), scenes())
    with pytest.raises(InputError, match=said):
        exclude(read, [rule])


def test_a_rule_on_response_times_needs_them(tmp_path):
    read = read_responses(written(tmp_path, good().drop(columns="rt")), scenes())
    with pytest.raises(InputError, match="needs the column 'rt'"):
        exclude(read, ["max-rt=3"])
