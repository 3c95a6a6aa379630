"""The design file: the paper's by default, and one line for whatever is wrong in it."""

import json

import pytest

from pourcast.errors import InputError
from pourcast.experiment.design.settings import Design, default_design, read_design, texts_of
from pourcast.files import write_text
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.scene_file import write_scenes
from pourcast.study.experiments.registry import EXPERIMENTS
from tests.experiment.make import scenes_of


def design_of(folder, text, experiment="exp1"):
    write_scenes(folder / "scenes.json", scenes_of(experiment, 2))
    write_text(folder / "experiment.toml", text)
    return read_design(folder)


@pytest.mark.parametrize(
    ("name", "groups", "mirrored"),
    [("exp1", (("water",), ("honey",)), ()), ("exp2", (("water", "honey"),), ("honey",))],
)
def test_the_default_is_the_papers(tmp_path, name, groups, mirrored):
    design = design_of(tmp_path, default_design(EXPERIMENTS.get(name), 15), name)
    assert design == Design(groups=groups, mirrored=mirrored)
    assert (design.practice, design.blocks, design.order) == (15, 3, "shared")


def test_the_choices_that_the_default_only_shows_are_choices(tmp_path):
    design_of(tmp_path, default_design(EXPERIMENTS.get("exp1"), 2))
    path = tmp_path / "experiment.toml"
    before = path.read_text()
    for shown in ("contact", "places", "complete", "redirect"):
        assert f"# {shown} = " in before
        path.write_text(before.replace(f"# {shown} = ", f"{shown} = "))
        assert read_design(tmp_path) != Design(groups=(("water",), ("honey",)), practice=2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "groups: Field required"),
        ("groups = []", "groups: "),
        ('groups = [["oil"]]', "groups: liquid: there is no 'oil'; .*known: water, honey"),
        ('groups = [["water", "water"]]', "groups: expected different liquids in a group"),
        ('groups = [["water"], ["water"]]', "groups: two groups see the same"),
        ('groups = [["water"]]\nmirrored = ["honey"]', "mirrored: no group sees 'honey'"),
        ('groups = [["water"]]\nblocs = 3', "blocs: Extra inputs are not permitted"),
        ('groups = [["water"]]\n[slider]\nstart = "left"', r"slider.start: Input should be 'none'"),
        ("groups = [", "not TOML"),
        ('groups = [["water"]]\n[texts.consent]\nbdoy = "x"', "texts.consent.bdoy: unknown"),
        ('groups = [["water"]]\n[texts.consent]\nbody = 3', "texts.consent.body: expected str"),
        ('groups = [["water"]]\nlanguage = "xx"', "no texts in 'xx' come with pourcast"),
    ],
)
def test_what_is_wrong_is_told_with_file_and_field(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as told:
        design_of(tmp_path, text)
    assert "\n" not in str(told.value)


def test_a_studys_own_words_stand_over_the_languages(tmp_path):
    text = 'title = "Pouring"\ngroups = [["water"]]\n[texts.consent]\nbody = "Ours."'
    texts = texts_of(tmp_path, design_of(tmp_path, text))
    assert texts["consent"]["body"] == "Ours."
    assert texts["consent"]["title"] == "Welcome"
    assert texts["page"]["title"] == "Pouring"
    assert texts["page"]["continue"] == "Continue"


def test_a_translation_is_one_file_and_must_be_whole(tmp_path):
    from importlib.resources import files

    english = files("pourcast.experiment.design").joinpath("texts", "en.toml").read_text("utf-8")
    write_text(tmp_path / "texts.de.toml", english)
    with pytest.raises(InputError, match=r"goals\.basins is missing; translate the English"):
        design_of(tmp_path, 'groups = [["water"]]\nlanguage = "de"')
    words = {**Basins.words["en"], "question": "Wieviel {liquid}?"}
    asked = "\n".join(
        f"{key} = {json.dumps(value)}" for key, value in words.items() if key != "quiz"
    )
    for question in words["quiz"]:
        lines = [f"{key} = {json.dumps(value)}" for key, value in question.items()]
        asked += "\n" + "\n".join(["[[goals.basins.quiz]]", *lines])
    english += f"\n[goals.basins]\n{asked}\n"
    write_text(tmp_path / "texts.de.toml", english.replace('"Continue"', '"Weiter"'))
    text = 'groups = [["water"]]\nlanguage = "de"'
    texts = texts_of(tmp_path, design_of(tmp_path, text))
    assert texts["page"]["continue"] == "Weiter"
    assert texts["goal"]["question"] == "Wieviel {liquid}?"
    write_text(tmp_path / "texts.de.toml", english.replace("saving = ", "sawing = "))
    with pytest.raises(InputError, match=r"'de': de.page.saving is missing"):
        read_design(tmp_path)


def test_an_older_experiment_shows_its_own_liquids_only(tmp_path):
    write_text(tmp_path / "study.toml", 'experiment = "exp1-v0"\n')
    for other, own in (("water", "water-v0"), ("honey", "honey-exp1-v0")):
        with pytest.raises(
            InputError, match=rf"experiment\.toml: groups: '{other}' is not what .*liquid, '{own}'"
        ):
            design_of(tmp_path, f'groups = [["{other}"]]\n')
    # One of its liquids alone, and one that it doesn't know.
    texts = texts_of(tmp_path, design_of(tmp_path, 'groups = [["water-v0"], ["honey-exp2"]]\n'))
    assert texts["liquids"]["water-v0"]["name"] == "water"
    assert list(texts["liquids"]) == ["water-v0", "honey-exp2"]


OIL = "[liquids.oil]\nviscosity_alpha = 0.4\nkinematic_viscosity = 5e-5\n"


def test_a_studys_own_liquid_can_be_shown_and_goes_by_its_name(tmp_path):
    write_text(tmp_path / "study.toml", OIL)
    text = 'groups = [["water", "oil"]]\n'
    liquids = texts_of(tmp_path, design_of(tmp_path, text))["liquids"]
    assert liquids["water"]["description"] == "The blue liquid is water."
    assert liquids["oil"] == {"name": "oil", "description": "The liquid is oil."}
    text += '[texts.liquids.oil]\ndescription = "The brown liquid is olive oil."\n'
    liquids = texts_of(tmp_path, design_of(tmp_path, text))["liquids"]
    assert liquids["oil"]["description"] == "The brown liquid is olive oil."


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[liquids.oil]\n", "liquids.oil: viscosity_alpha: "),
        (OIL + "slip = 2\n", "liquids.oil: liquid 'oil': slip: expected 0 to 1, found 2"),
        (OIL + "colour = 'brown'\n", "colour: expected #rrggbb, found 'brown'"),
        (OIL + "wetness = 1\n", "liquids.oil: there is no 'wetness'; .*known: viscosity_alpha"),
        (OIL + "called = 'honey'\n", "liquids.oil: called: a study's own liquid goes by its name"),
        (OIL.replace("oil", "water"), "liquid 'water': there is one of that name already"),
        (OIL.replace("oil", "honey"), "liquid 'honey': there is one of that name already"),
        (OIL.replace("oil", "Oil"), "expected small letters, digits and hyphens.* found 'Oil'"),
        ("liquids = 3\n", "liquids: "),
        ("experiment = 'exp9'\n", "experiment: there is no 'exp9'"),
    ],
)
def test_what_is_wrong_in_the_studys_file_is_told_with_file_and_field(tmp_path, text, message):
    write_text(tmp_path / "study.toml", text)
    with pytest.raises(InputError, match=message) as told:
        design_of(tmp_path, 'groups = [["water"]]')
    assert "study.toml: " in str(told.value)
    assert "\n" not in str(told.value)


def test_scenes_that_ask_different_things_are_refused(tmp_path):
    write_scenes(tmp_path / "scenes.json", [*scenes_of("exp1", 1, "a"), *scenes_of("exp2", 1, "b")])
    write_text(tmp_path / "experiment.toml", 'groups = [["water"]]')
    with pytest.raises(InputError, match="different goals \\(basins, cup\\); an experiment asks"):
        read_design(tmp_path)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            '[[texts.goal.quiz]]\nquestion = "x"',
            r"texts.goal, .*: quiz\[0\].choices: Field required",
        ),
        (
            '[[texts.goal.quiz]]\nquestion = "x"\nchoices = ["a", "b"]\nright = 2',
            r"quiz\[0\]: right: expected 0 to 1, found 2",
        ),
        (
            "[texts.goal]\ninstructions = [1, 2]",
            r"instructions\[0\]: Input should be a valid string",
        ),
        ('[texts.liquids]\nwater = "W"', "texts.liquids.water: expected dict"),
        ("[texts]\nliquids = 3", "texts.liquids: expected tables such as"),
        ("[texts.liquids.water]\nname = 5", "texts.liquids.water.name: expected str"),
    ],
)
def test_words_of_the_wrong_kind_are_told(tmp_path, texts, message):
    with pytest.raises(InputError, match=message) as told:
        design_of(tmp_path, f'groups = [["water"]]\n{texts}')
    assert "\n" not in str(told.value)


def test_one_liquid_under_two_names_is_one_liquid(tmp_path):
    with pytest.raises(InputError, match="honey and honey-exp1 are not all different here"):
        design_of(tmp_path, 'groups = [["honey", "honey-exp1"]]')
