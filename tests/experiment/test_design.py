"""The design file: the paper's by default, and one line for whatever is wrong in it."""

import pytest

from pourcast.errors import InputError
from pourcast.experiment.design.settings import NAME, Design, default_design, read_design, texts_of
from pourcast.files import write_text


def design_of(folder, text):
    write_text(folder / "experiment.toml", text)
    return read_design(folder)


@pytest.mark.parametrize(
    ("goal", "groups", "mirrored"),
    [("basins", (("water",), ("honey",)), ()), ("cup", (("water", "honey"),), ("honey",))],
)
def test_the_default_is_the_papers(tmp_path, goal, groups, mirrored):
    (tmp_path / NAME).write_text(default_design(goal, 15))
    design = read_design(tmp_path)
    assert design == Design(groups=groups, mirrored=mirrored)
    assert (design.practice, design.blocks, design.order) == (15, 3, "shared")


def test_the_choices_that_the_default_only_shows_are_choices(tmp_path):
    (tmp_path / NAME).write_text(default_design("basins", 2))
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
        ('groups = [["oil"]]', r"groups\[0\]\[0\]: Input should be 'water' or 'honey'"),
        ('groups = [["water", "water"]]', "groups: expected one or two different liquids"),
        ('groups = [["water"], ["water"]]', "groups: two groups see the same"),
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
    write_text(tmp_path / "texts.de.toml", english.replace('"Continue"', '"Weiter"'))
    text = 'groups = [["water"]]\nlanguage = "de"'
    assert texts_of(tmp_path, design_of(tmp_path, text))["page"]["continue"] == "Weiter"
    write_text(tmp_path / "texts.de.toml", english.replace("saving = ", "sawing = "))
    with pytest.raises(InputError, match=r"'de': de.page.saving is missing"):
        read_design(tmp_path)
