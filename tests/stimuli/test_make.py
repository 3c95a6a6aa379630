"""Making stimuli: each once, whole, from where it stopped; sets that are made alike."""

import json
import sys

import av
import numpy as np
import pytest
from PIL import Image

from pourcast import cli
from pourcast.comparison.stimulus import stimulus_truth
from pourcast.errors import InputError, StoreError
from pourcast.scenes.scene_file import write_scenes
from pourcast.stimuli import cycles, task
from pourcast.stimuli.contact_sheet import last_picture, write_contact_sheet
from pourcast.stimuli.make import make_stimuli
from pourcast.stimuli.manifest import NAME, Wanted, best_set, read_set, set_folder
from pourcast.stimuli.recipe import (
    CyclesRecipe,
    LatticeRecipe,
    ParticleRecipe,
    PreviewRecipe,
    Recipe,
)
from pourcast.stimuli.solvers import lbm
from pourcast.stimuli.task import WORK, StimulusTask
from tests.make import ramp_scene, random_scenes

SMALL = PreviewRecipe(width=80)
QUICK = Recipe(flow=ParticleRecipe(), look=SMALL, seconds=0.2)
LATTICE = Recipe(flow=LatticeRecipe(resolution=24), look=SMALL, seconds=0.2)


def films(*scenes, liquids=("water", "honey")):
    return [Wanted(scene, liquid, film=True) for scene in scenes for liquid in liquids]


@pytest.mark.parametrize("recipe", [QUICK, LATTICE])
def test_a_still_is_its_films_first_picture(ramp, tmp_path, recipe):
    made = make_stimuli(tmp_path, films(ramp, liquids=["water"]), recipe)
    (stimulus,) = made.manifest.stimuli
    still = np.asarray(Image.open(made.folder / stimulus.still), float)
    assert still.shape == (120, 80, 3)
    with av.open(str(made.folder / stimulus.film)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        about = json.loads(film.metadata["comment"])
    assert len(frames) == 6
    assert np.abs(frames[0] - still).mean() < 4.0
    assert about == {
        "scene": ramp.digest, "liquid": "water", "solver": recipe.flow.solver,
        "renderer": "preview", "seed": 0,
    }  # fmt: skip
    assert not (made.folder / WORK / f"{ramp.digest}-water").exists()


def test_a_still_needs_no_film(ramp, tmp_path):
    made = make_stimuli(tmp_path, [Wanted(ramp, "honey")], QUICK)
    (stimulus,) = made.manifest.stimuli
    assert (stimulus.film, stimulus.outcome, stimulus.stranded) == (None, None, None)


def test_the_outcome_is_the_pours_and_no_file_name_tells_it(ramp, tmp_path):
    recipe = LATTICE.model_copy(update={"seconds": 1.5})
    made = make_stimuli(tmp_path, films(ramp, liquids=["water"]), recipe)
    (stimulus,) = made.manifest.stimuli
    outcome, stranded = lbm.pour_to_end(ramp, "water", recipe.flow, 44 / 30)
    assert stimulus.outcome == pytest.approx(outcome, abs=0.02)
    assert stimulus.stranded == pytest.approx(stranded, abs=0.02)
    assert {name.partition(".")[0] for name in stimulus.files} == {f"{ramp.digest}-water"}


def test_what_is_there_is_not_made_again_and_what_is_damaged_is(ramp, tmp_path):
    wanted = [Wanted(ramp, "water"), Wanted(ramp, "honey")]
    first = make_stimuli(tmp_path, wanted, QUICK)
    still = first.folder / first.manifest.stimuli[0].still
    made = still.stat().st_mtime_ns
    told = []
    assert make_stimuli(tmp_path, wanted, QUICK, report=lambda *words: told.append(words)) == first
    assert still.stat().st_mtime_ns == made
    assert told == []
    still.write_bytes(b"damaged")
    assert not first.is_whole(first.manifest.stimuli[0])
    assert make_stimuli(tmp_path, wanted, QUICK) == first
    assert first.is_whole(first.manifest.stimuli[0])


def test_what_two_groups_see_is_made_once(ramp, tmp_path):
    told = []
    wanted = [Wanted(ramp, "water"), Wanted(ramp, "water", film=True), Wanted(ramp, "water")]
    made = make_stimuli(tmp_path, wanted, QUICK, report=lambda *words: told.append(words))
    assert [bool(one.film) for one in made.manifest.stimuli] == [True]
    assert told[-1] == ("making stimuli", 1, 1)


@pytest.mark.parametrize("recipe", [QUICK, LATTICE])
def test_the_same_scene_makes_the_same_bytes_whatever_the_workers(ramp, tmp_path, recipe):
    recipe = recipe.model_copy(update={"webm": True})
    scenes = [ramp, ramp.mirrored()]
    one = make_stimuli(tmp_path / "a", films(*scenes, liquids=["water"]), recipe)
    other = make_stimuli(tmp_path / "b", films(*scenes), recipe, workers=2)
    for stimulus in one.manifest.stimuli:
        assert stimulus in other.manifest.stimuli
        assert stimulus.webm
    assert len(other.manifest.stimuli) == 4


def test_work_that_is_interrupted_goes_on(ramp, tmp_path):
    def interrupt(what, done, total):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_stimuli(tmp_path, films(ramp), QUICK, report=interrupt)
    assert len(read_set(set_folder(tmp_path, QUICK.name)).manifest.stimuli) == 1
    told = []
    made = make_stimuli(tmp_path, films(ramp), QUICK, report=lambda *words: told.append(words))
    assert len(made.manifest.stimuli) == 2
    assert told == [("making stimuli", 0, 1), ("making stimuli", 1, 1)]


def test_a_stimulus_that_was_finished_but_not_listed_is_not_made_again(ramp, tmp_path):
    folder = set_folder(tmp_path, QUICK.name)
    make_stimuli(tmp_path, [], QUICK)
    one = StimulusTask(folder, Wanted(ramp, "water", film=True), QUICK)
    assert one.run().outcome == "done"
    told = []
    made = make_stimuli(
        tmp_path, films(ramp, liquids=["water"]), QUICK, report=lambda *words: told.append(words)
    )
    assert len(made.manifest.stimuli) == 1
    assert told == []


def test_a_stimulus_that_another_process_is_at_is_left_to_it(ramp, tmp_path):
    one = StimulusTask(tmp_path, Wanted(ramp, "water"), QUICK)
    (tmp_path / WORK).mkdir()
    with task.FileLock(tmp_path / WORK / f"{one.id}.lock"):
        assert one.run().outcome == "busy"


def test_a_failure_is_told_and_the_others_are_made(ramp, tmp_path, monkeypatch):
    def refuse(scene, liquid, *rest, **more):
        if liquid == "honey":
            raise OSError(28, "No space left on device")
        return sph_pour(scene, liquid, *rest, **more)

    sph_pour = task.sph.pour
    monkeypatch.setattr(task.sph, "pour", refuse)
    with pytest.raises(StoreError, match=r"1 of 2 stimuli could not be made .*No space left"):
        make_stimuli(tmp_path, films(ramp), QUICK)
    monkeypatch.undo()
    assert len(make_stimuli(tmp_path, films(ramp), QUICK).manifest.stimuli) == 2


def test_a_set_is_made_by_one_recipe(ramp, tmp_path):
    make_stimuli(tmp_path, [Wanted(ramp, "water")], QUICK)
    wider = QUICK.model_copy(update={"look": PreviewRecipe(width=100)})
    with pytest.raises(InputError, match=r"sph-preview: made with other settings \(width 80, not"):
        make_stimuli(tmp_path, [Wanted(ramp, "water")], wider)
    made = make_stimuli(tmp_path, [Wanted(ramp, "water")], wider, replace=True)
    with Image.open(made.folder / made.manifest.stimuli[0].still) as still:
        assert still.width == 100


def test_the_best_set_that_is_whole_is_shown(ramp, tmp_path):
    wanted = [Wanted(ramp, "water"), Wanted(ramp, "honey")]
    assert best_set(tmp_path, wanted) is None
    quick = make_stimuli(tmp_path, wanted, QUICK)
    half = make_stimuli(tmp_path, wanted[:1], LATTICE)
    assert best_set(tmp_path, wanted) == quick
    assert best_set(tmp_path, wanted[:1]) == half
    whole = make_stimuli(tmp_path, wanted, LATTICE)
    assert best_set(tmp_path, wanted) == whole


def test_a_damaged_list_is_told_of(ramp, tmp_path):
    made = make_stimuli(tmp_path, [Wanted(ramp, "water")], QUICK)
    path = made.folder / NAME
    path.write_text(path.read_text().replace('"still"', '"stil"'))
    with pytest.raises(InputError, match=r"manifest.json: stimuli\[0\].still: Field required"):
        read_set(made.folder)


def test_what_was_rendered_is_not_rendered_again(ramp, tmp_path, monkeypatch):
    # Blender's part is played by a program that stops after two pictures, and goes on later.
    blender = tmp_path / "python-blender"
    blender.write_text(
        f"#!{sys.executable}\n"
        "import json, shutil, sys\n"
        "job = json.load(open(sys.argv[3]))\n"
        "for number, (mesh, picture) in enumerate(job['pictures']):\n"
        "    if number == 2 and len(job['pictures']) == 6: sys.exit('out of memory')\n"
        f"    shutil.copy({str(tmp_path / 'grey.png')!r}, picture)\n"
        "    print('picture done', flush=True)\n"
    )
    blender.chmod(0o755)
    Image.new("RGB", (80, 120), "grey").save(tmp_path / "grey.png")
    monkeypatch.setenv(cycles.VARIABLE, str(blender))
    recipe = replace_look(CyclesRecipe(width=80, height=120, samples=1))
    wanted = films(ramp, liquids=["water"])
    with pytest.raises(StoreError, match="Blender stopped after 2 of 6 pictures: out of memory"):
        make_stimuli(tmp_path, wanted, recipe)
    work = StimulusTask(set_folder(tmp_path, recipe.name), wanted[0], recipe)
    assert work.pictures_done == 2
    told = []
    made = make_stimuli(tmp_path, wanted, recipe, report=lambda *words: told.append(words))
    assert told[0] == ("rendering pictures", 2, 6)
    assert told[-1] == ("rendering pictures", 6, 6)
    assert last_picture(made.folder / made.manifest.stimuli[0].film).size == (80, 120)


def replace_look(look):
    return QUICK.model_copy(update={"look": look})


def test_without_blender_it_is_said_what_to_do(ramp, tmp_path, monkeypatch):
    monkeypatch.delenv(cycles.VARIABLE, raising=False)
    monkeypatch.setattr(
        cycles.importlib.util, "find_spec", lambda name: None if name == "bpy" else 1
    )
    monkeypatch.setattr(cycles.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match=r"needs Blender: pip install 'pourcast\[stimuli\]'"):
        make_stimuli(tmp_path, [Wanted(ramp, "water")], replace_look(CyclesRecipe()))
    monkeypatch.setenv(cycles.VARIABLE, "no-such-blender")
    with pytest.raises(InputError, match="POURCAST_BLENDER: no-such-blender: no such program"):
        cycles.find_blender()


def test_a_contact_sheet_shows_how_all_begin_and_end(ramp, tmp_path):
    made = make_stimuli(tmp_path, films(ramp), QUICK)
    mirrored = random_scenes(1)[0]
    path = write_contact_sheet(made, [ramp, mirrored])
    image = np.asarray(Image.open(path), float)
    assert (image < 250).any(axis=2).mean() > 0.3
    assert image.shape[1] > 3 * 150


# The comparison's truth -----------------------------------------------------------------


def test_outcomes_of_the_lattice_are_a_ground_truth(ramp, tmp_path):
    cup = random_scenes(2)[1]
    scenes = [ramp, cup]
    assert stimulus_truth(tmp_path, scenes, "water") is None
    make_stimuli(tmp_path, films(*scenes, liquids=["water"]), QUICK)
    assert stimulus_truth(tmp_path, scenes, "water") is None  # of the models' own kind
    made = make_stimuli(
        tmp_path, films(ramp.mirrored(), cup.mirrored(), liquids=["water"]), LATTICE
    )
    first, second = (one.outcome for one in made.manifest.stimuli)
    assert stimulus_truth(tmp_path, scenes, "water") == pytest.approx([1.0 - first, second])
    assert stimulus_truth(tmp_path, scenes, "honey") is None


# The command ----------------------------------------------------------------------------


@pytest.fixture
def study(tmp_path):
    write_scenes(tmp_path / "scenes.json", [ramp_scene(), *exp1_scenes(1)])
    return tmp_path


def exp1_scenes(count):
    return [scene for scene in random_scenes(2 * count) if scene.goal.kind == "basins"]


SHORT = ["--resolution", "20", "--seconds", "0.1", "--size", "80x120"]


def test_the_command_films_all_scenes_and_liquids(study, capsys):
    assert cli.run(["stimuli", str(study), *SHORT]) == 0
    said = capsys.readouterr().out
    assert "lbm-preview: 4 stimuli" in said
    assert (study / "stimuli" / "lbm-preview" / "contact-sheet.png").is_file()
    assert not (study / "experiment.toml").exists()
    assert cli.run(["stimuli", str(study), *SHORT, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {one["liquid"] for one in found["stimuli"]} == {"water", "honey"}


def test_some_scenes_and_one_liquid_can_be_chosen(study, capsys):
    call = ["stimuli", str(study), "--solver", "sph", "--seconds", "0.1", "--size", "80"]
    assert cli.run([*call, "--scenes", "1", "--liquid", "water"]) == 0
    assert "1 stimuli" in capsys.readouterr().out
    assert cli.run([*call, "--scene", "2", "--liquid", "honey"]) == 0
    assert "2 stimuli" in capsys.readouterr().out


def test_a_cups_honey_is_filmed_mirrored_as_the_design_says(tmp_path, capsys):
    (cup,) = [scene for scene in random_scenes(2) if scene.goal.kind == "cup"]
    write_scenes(tmp_path / "scenes.json", [cup])
    assert cli.run(["stimuli", str(tmp_path), *SHORT]) == 0
    made = read_set(set_folder(tmp_path, "lbm-preview"))
    assert made.find(cup, "water")
    assert made.find(cup, "honey") is None
    assert made.find(cup.mirrored(), "honey")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["--size", "wide"],
            "size: expected WIDTHxHEIGHT in pixels, such as 640x960, found 'wide'",
        ),
        (["--size", "81"], "multiple of 2"),
        (["--resolution", "5"], "resolution"),
        (["--seconds", "-1"], "seconds"),
        (["--scene", "9"], "scene: expected a number from 1 to 2"),
        (["--executor", "dask"], "expected --scheduler ADDRESS"),
    ],
)
def test_bad_options_are_told_in_one_line(study, capsys, options, said):
    assert cli.run(["stimuli", str(study), *options]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_settings_that_differ_are_refused_before_anything_is_lost(study, capsys):
    assert cli.run(["stimuli", str(study), *SHORT, "--scenes", "1"]) == 0
    capsys.readouterr()
    assert cli.run(["stimuli", str(study), *SHORT, "--honey-slip", "0"]) == 2
    assert "honey_slip 1.0, not 0.0" in capsys.readouterr().err
    made = read_set(set_folder(study, "lbm-preview"))
    assert all(made.is_whole(one) for one in made.manifest.stimuli)
