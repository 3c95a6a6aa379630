"""Making stimuli: each once, whole, from where it stopped; sets that are made alike."""

import json
import sys
from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image

from pourcast import cli
from pourcast.comparison.stimulus import stimulus_truth
from pourcast.errors import InputError, StoreError
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import HONEY_EXP1, HONEY_EXP2, WATER, resolve_liquid
from pourcast.scenes.scene_file import write_scenes
from pourcast.stimuli import task
from pourcast.stimuli.contact_sheet import last_picture, write_contact_sheet
from pourcast.stimuli.make import make_stimuli
from pourcast.stimuli.manifest import NAME, StimulusRequest, best_set, read_set, set_folder
from pourcast.stimuli.renderers import cycles
from pourcast.stimuli.renderers.cycles import Cycles
from pourcast.stimuli.renderers.preview import Preview
from pourcast.stimuli.settings import StimulusSettings
from pourcast.stimuli.solvers import lbm
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann
from pourcast.stimuli.solvers.sph import ParticleEngine
from pourcast.stimuli.task import WORK, StimulusTask
from pourcast.study.folder import study_liquids
from tests.make import ramp_scene, random_scenes

SMALL = Preview(width=80)
QUICK = StimulusSettings(solver=ParticleEngine(), renderer=SMALL, seconds=0.2)
LATTICE = StimulusSettings(solver=LatticeBoltzmann(resolution=24), renderer=SMALL, seconds=0.2)
WHOLE = LATTICE.model_copy(update={"seconds": None})


def films(*scenes, liquids=("water", "honey")):
    return [
        StimulusRequest(scene, resolve_liquid(liquid, scene), film=True)
        for scene in scenes
        for liquid in liquids
    ]


@pytest.mark.parametrize("settings", [QUICK, LATTICE])
def test_a_still_is_its_films_first_picture(ramp, tmp_path, settings):
    made = make_stimuli(tmp_path, films(ramp, liquids=["water"]), settings)
    (stimulus,) = made.manifest.stimuli
    still = np.asarray(Image.open(made.folder / stimulus.still), float)
    assert still.shape == (120, 80, 3)
    with av.open(str(made.folder / stimulus.film)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        about = json.loads(film.metadata["comment"])
    assert len(frames) == 6
    assert np.abs(frames[0] - still).mean() < 4.0
    assert about == {
        "scene": ramp.digest, "liquid": "water", "solver": settings.solver.name,
        "renderer": "preview", "seed": 0,
    }  # fmt: skip
    assert not (made.folder / WORK / f"{ramp.digest}-water").exists()


def test_a_still_needs_no_film(ramp, tmp_path):
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, HONEY_EXP1)], QUICK)
    (stimulus,) = made.manifest.stimuli
    assert (stimulus.film, stimulus.outcome, stimulus.stranded) == (None, None, None)


def test_the_outcome_is_the_pours_and_no_file_name_tells_it(ramp, tmp_path):
    settings = LATTICE.model_copy(update={"seconds": 1.5})
    made = make_stimuli(tmp_path, films(ramp, liquids=["water"]), settings)
    (stimulus,) = made.manifest.stimuli
    outcome, stranded = lbm.pour_to_end(ramp, WATER, settings.solver, 44 / 30)
    assert stimulus.outcome == pytest.approx(outcome)
    assert stimulus.stranded == pytest.approx(stranded)
    assert {name.partition(".")[0] for name in stimulus.files} == {f"{ramp.digest}-water"}


def test_what_is_there_is_not_made_again_and_what_is_damaged_is(ramp, tmp_path):
    requests = [StimulusRequest(ramp, WATER), StimulusRequest(ramp, HONEY_EXP1)]
    first = make_stimuli(tmp_path, requests, QUICK)
    still = first.folder / first.manifest.stimuli[0].still
    made = still.stat().st_mtime_ns
    told = []
    assert (
        make_stimuli(tmp_path, requests, QUICK, report=lambda *words: told.append(words)) == first
    )
    assert still.stat().st_mtime_ns == made
    assert told == []
    still.write_bytes(b"damaged")
    assert not first.is_whole(first.manifest.stimuli[0])
    assert make_stimuli(tmp_path, requests, QUICK) == first
    assert first.is_whole(first.manifest.stimuli[0])


def test_what_two_groups_see_is_made_once(ramp, tmp_path):
    told = []
    requests = [
        StimulusRequest(ramp, WATER),
        StimulusRequest(ramp, WATER, film=True),
        StimulusRequest(ramp, WATER),
    ]
    made = make_stimuli(tmp_path, requests, QUICK, report=lambda *words: told.append(words))
    assert [bool(one.film) for one in made.manifest.stimuli] == [True]
    count = StimulusTask(tmp_path, requests[1], QUICK).picture_count
    assert told[-1] == ("pouring pictures", count, count)


@pytest.mark.parametrize("settings", [QUICK, LATTICE])
def test_the_same_scene_makes_the_same_bytes_whatever_the_workers(ramp, tmp_path, settings):
    settings = settings.model_copy(update={"webm": True})
    scenes = [ramp, ramp.mirrored()]
    one = make_stimuli(tmp_path / "a", films(*scenes, liquids=["water"]), settings)
    other = make_stimuli(tmp_path / "b", films(*scenes), settings, workers=2)
    for stimulus in one.manifest.stimuli:
        assert stimulus in other.manifest.stimuli
        assert stimulus.webm
    assert len(other.manifest.stimuli) == 4


def test_work_that_is_interrupted_goes_on(ramp, tmp_path):
    def interrupt(what, done, total):
        if len(read_set(set_folder(tmp_path, QUICK.name)).manifest.stimuli) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_stimuli(tmp_path, films(ramp), QUICK, report=interrupt)
    assert len(read_set(set_folder(tmp_path, QUICK.name)).manifest.stimuli) == 1
    told = []
    made = make_stimuli(tmp_path, films(ramp), QUICK, report=lambda *words: told.append(words))
    assert len(made.manifest.stimuli) == 2
    assert len({total for _, _, total in told}) == 1
    assert (told[0][1], told[-1][1]) == (0, told[-1][2])


def test_a_stimulus_that_was_finished_but_not_listed_is_not_made_again(ramp, tmp_path):
    folder = set_folder(tmp_path, QUICK.name)
    make_stimuli(tmp_path, [], QUICK)
    one = StimulusTask(folder, StimulusRequest(ramp, WATER, film=True), QUICK)
    assert one.run().outcome == "done"
    told = []
    made = make_stimuli(
        tmp_path, films(ramp, liquids=["water"]), QUICK, report=lambda *words: told.append(words)
    )
    assert len(made.manifest.stimuli) == 1
    assert told == []


def test_an_entry_that_another_process_is_writing_is_left_to_it(ramp, tmp_path):
    folder = set_folder(tmp_path, QUICK.name)
    make_stimuli(tmp_path, [], QUICK)
    assert StimulusTask(folder, StimulusRequest(ramp, WATER), QUICK).run().outcome == "done"
    (entry,) = (folder / WORK).glob("*.json")
    temporary = entry.rename(entry.with_name(f".{entry.stem}-b93w33kd.json"))
    assert make_stimuli(tmp_path, [], QUICK).manifest.stimuli == ()
    assert temporary.is_file()


def test_a_stimulus_that_another_process_is_at_is_left_to_it(ramp, tmp_path):
    one = StimulusTask(tmp_path, StimulusRequest(ramp, WATER), QUICK)
    (tmp_path / WORK).mkdir()
    with task.FileLock(tmp_path / WORK / f"{one.id}.lock"):
        assert one.run().outcome == "busy"


def test_two_processes_do_not_make_one_set_at_once(ramp, tmp_path):
    made = make_stimuli(tmp_path, films(ramp), QUICK)
    folder = set_folder(tmp_path, QUICK.name)
    with (
        task.FileLock(folder.parent / f".{folder.name}.lock"),
        pytest.raises(StoreError, match="another process is making these stimuli"),
    ):
        make_stimuli(tmp_path, films(ramp), QUICK, replace=True)
    assert make_stimuli(tmp_path, films(ramp), QUICK) == made


def test_a_damaged_pour_is_made_again(ramp, tmp_path):
    whole = make_stimuli(tmp_path, films(ramp), QUICK)
    other = tmp_path / "other"
    for request in films(ramp):
        pour = set_folder(other, QUICK.name) / WORK / request.id / "pour.npz"
        pour.parent.mkdir(parents=True)
        pour.write_bytes(b"PK\x03\x04 not a pour")
    folder = set_folder(other, QUICK.name)
    for request in films(ramp):
        assert StimulusTask(folder, request, QUICK).run().outcome == "done"
    assert make_stimuli(other, films(ramp), QUICK).manifest == whole.manifest


def test_a_set_that_is_begun_anew_keeps_no_files_of_the_old(ramp, tmp_path):
    make_stimuli(tmp_path, films(ramp), LATTICE)
    finer = LATTICE.model_copy(update={"solver": LatticeBoltzmann(resolution=30)})
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], finer, replace=True)
    files = {path.name for path in made.folder.glob("*.*")}
    assert files == {"manifest.json", *made.manifest.stimuli[0].files}


def test_a_failure_is_told_and_the_others_are_made(ramp, tmp_path, monkeypatch):
    def refuse(solver, scene, liquid, *rest, **more):
        if liquid == HONEY_EXP1:
            raise OSError(28, "No space left on device")
        return pour(solver, scene, liquid, *rest, **more)

    pour = ParticleEngine.pour
    monkeypatch.setattr(ParticleEngine, "pour", refuse)
    with pytest.raises(StoreError, match=r"1 of 2 stimuli could not be made .*No space left"):
        make_stimuli(tmp_path, films(ramp), QUICK)
    monkeypatch.undo()
    assert len(make_stimuli(tmp_path, films(ramp), QUICK).manifest.stimuli) == 2


def test_a_set_is_made_with_one_kind_of_settings(ramp, tmp_path):
    make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], QUICK)
    wider = QUICK.model_copy(update={"renderer": Preview(width=100)})
    with pytest.raises(InputError, match=r"sph-preview: made with other settings \(width 80, not"):
        make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], wider)
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], wider, replace=True)
    with Image.open(made.folder / made.manifest.stimuli[0].still) as still:
        assert still.width == 100


def test_the_best_set_that_is_whole_is_shown(ramp, tmp_path):
    requests = [StimulusRequest(ramp, WATER), StimulusRequest(ramp, HONEY_EXP1)]
    assert best_set(tmp_path, requests) is None
    quick = make_stimuli(tmp_path, requests, QUICK)
    half = make_stimuli(tmp_path, requests[:1], LATTICE)
    assert best_set(tmp_path, requests) == quick
    assert best_set(tmp_path, requests[:1]) == half
    whole = make_stimuli(tmp_path, requests, LATTICE)
    assert best_set(tmp_path, requests) == whole


def test_a_damaged_list_is_told_of(ramp, tmp_path):
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], QUICK)
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
    settings = with_renderer(Cycles(width=80, height=120, samples=1))
    requests = films(ramp, liquids=["water"])
    with pytest.raises(StoreError, match="Blender stopped after 2 of 6 pictures: out of memory"):
        make_stimuli(tmp_path, requests, settings)
    work = StimulusTask(set_folder(tmp_path, settings.name), requests[0], settings)
    assert work.pictures_done == 2
    told = []
    made = make_stimuli(tmp_path, requests, settings, report=lambda *words: told.append(words))
    assert told[0] == ("rendering pictures", 2, 6)
    assert told[-1] == ("rendering pictures", 6, 6)
    assert last_picture(made.folder / made.manifest.stimuli[0].film).size == (80, 120)


def with_renderer(renderer):
    return QUICK.model_copy(update={"renderer": renderer})


def test_without_blender_it_is_said_what_to_do(ramp, tmp_path, monkeypatch):
    monkeypatch.delenv(cycles.VARIABLE, raising=False)
    monkeypatch.setattr(
        cycles.importlib.util, "find_spec", lambda name: None if name == "bpy" else 1
    )
    monkeypatch.setattr(cycles.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match=r"needs Blender: pip install 'pourcast\[stimuli\]'"):
        make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], with_renderer(Cycles()))
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
    make_stimuli(tmp_path, films(*scenes, liquids=["water"]), LATTICE)
    assert stimulus_truth(tmp_path, scenes, "water") is None  # films that end before the liquid
    made = make_stimuli(
        tmp_path, films(ramp.mirrored(), cup.mirrored(), liquids=["water"]), WHOLE, replace=True
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
    assert {one["liquid"] for one in found["stimuli"]} == {"water", "honey-exp1"}


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
    assert made.find(cup, WATER)
    assert made.find(cup, HONEY_EXP2) is None
    assert made.find(cup.mirrored(), HONEY_EXP2)


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
    assert cli.run(["stimuli", str(study), *SHORT, "--real-size", "0.4"]) == 2
    assert "real_size 0.5, not 0.4" in capsys.readouterr().err
    made = read_set(set_folder(study, "lbm-preview"))
    assert all(made.is_whole(one) for one in made.manifest.stimuli)


def test_a_liquid_that_the_design_does_not_show_is_filmed_with_all_scenes_chosen(study, capsys):
    call = ["stimuli", str(study), "--solver", "sph", "--seconds", "0.1", "--size", "80"]
    assert cli.run([*call, "--liquid", "honey-exp2"]) == 0
    made = read_set(set_folder(study, "sph-preview"))
    assert {one.liquid for one in made.manifest.stimuli} == {"honey-exp2"}
    assert len(made.manifest.stimuli) == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--liquid", "hony"], "there is no 'hony'; did you mean 'honey'?"),
        (["--solver", "lpm"], "solver: there is no 'lpm'; did you mean 'lbm'? known: lbm, sph"),
        (["--renderer", "cycle"], "renderer: there is no 'cycle'; did you mean 'cycles'?"),
    ],
)
def test_a_name_that_is_not_known_is_told_with_those_that_are(study, capsys, options, said):
    assert cli.run(["stimuli", str(study), *options]) == 2
    assert said in capsys.readouterr().err


# Any liquid -----------------------------------------------------------------------------

SYRUP = Liquid(
    "syrup", viscosity_alpha=1.0, adhesion_normal=20.0, adhesion_tangential=20.0,
    kinematic_viscosity=1e-3, slip=0.0, colour="#aa2299", film_seconds=0.3,
)  # fmt: skip


@pytest.mark.parametrize("settings", [QUICK, LATTICE])
def test_any_liquid_is_poured_and_drawn_in_its_colour(ramp, tmp_path, settings):
    settings = settings.model_copy(update={"seconds": None})
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, SYRUP, film=True)], settings)
    stimulus = made.find(ramp, SYRUP)
    assert stimulus.still == f"{ramp.digest}-syrup.png"
    with av.open(str(made.folder / stimulus.film)) as film:
        assert sum(1 for _ in film.decode(video=0)) == 9
    image = np.asarray(Image.open(made.folder / stimulus.still), float)
    red, green, _ = np.moveaxis(image, 2, 0)
    assert (red - green > 60).sum() > 60
    sheet = write_contact_sheet(made, [ramp])
    assert np.asarray(Image.open(sheet)).shape[1] > 2 * 150


CHANGES = {
    "lbm": [("kinematic_viscosity", 2e-3), ("slip", 0.5), ("wall_pull", 1.0)],
    "sph": [
        ("viscosity_alpha", 2.0), ("adhesion_normal", 30.0), ("adhesion_tangential", 30.0),
    ],
}  # fmt: skip


@pytest.mark.parametrize("settings", [QUICK, LATTICE])
@pytest.mark.parametrize("change", [0, 1, 2, "colour"])
def test_another_liquid_of_the_same_name_is_not_taken_for_it(ramp, tmp_path, settings, change):
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, SYRUP)], settings)
    if change == "colour":
        field, value = "colour", "#123456"
    else:
        field, value = CHANGES[settings.solver.name][change]
    other = replace(SYRUP, **{field: value})
    request = StimulusRequest(ramp, other)
    assert made.find(ramp, other) is None
    said = f"made with other settings .syrup: {field} {getattr(SYRUP, field)}, not {value}.*--repl"
    with pytest.raises(InputError, match=said):
        make_stimuli(tmp_path, [request], settings)
    with pytest.raises(InputError, match=said):
        best_set(tmp_path, [request])
    assert made.is_whole(made.find(ramp, SYRUP))
    again = make_stimuli(tmp_path, [request], settings, replace=True)
    assert best_set(tmp_path, [request]) == again


def test_what_a_stimulus_does_not_depend_on_may_change(ramp, tmp_path):
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, SYRUP)], LATTICE)
    same = replace(SYRUP, viscosity_alpha=2.0, adhesion_normal=0.0, glass_colour="#123456")
    assert make_stimuli(tmp_path, [StimulusRequest(ramp, same)], LATTICE) == made


def test_outcomes_of_another_liquid_of_the_same_name_are_no_truth(ramp, tmp_path):
    own = tmp_path / "study.toml"
    own.write_text("[liquids.syrup]\nviscosity_alpha = 1.0\nkinematic_viscosity = 1e-3\n")
    make_stimuli(tmp_path, films(ramp, liquids=study_liquids(tmp_path)), WHOLE)
    assert stimulus_truth(tmp_path, [ramp], "syrup") is not None
    own.write_text(own.read_text() + "slip = 0.0\n")
    with pytest.raises(InputError, match=r"syrup: slip 1\.0, not 0\.0"):
        stimulus_truth(tmp_path, [ramp], "syrup")


def test_two_liquids_of_one_name_are_refused(ramp, tmp_path):
    other = replace(SYRUP, slip=1.0)
    with pytest.raises(InputError, match="liquid 'syrup': two liquids of one name"):
        make_stimuli(tmp_path, [StimulusRequest(ramp, SYRUP), StimulusRequest(ramp, other)], QUICK)


def test_a_list_of_an_older_version_is_told_of_and_can_be_replaced(ramp, tmp_path):
    made = make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], QUICK)
    path = made.folder / NAME
    path.write_text(path.read_text().replace('"schema_version": 3', '"schema_version": 2'))
    with pytest.raises(InputError, match=r"schema_version: Input should be 3; .* with --replace"):
        make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], QUICK)
    assert make_stimuli(tmp_path, [StimulusRequest(ramp, WATER)], QUICK, replace=True) == made


def test_films_of_another_solvers_code_are_kept_but_not_added_to(ramp, tmp_path, monkeypatch):
    known, new = StimulusRequest(ramp, WATER), StimulusRequest(ramp.mirrored(), WATER)
    made = make_stimuli(tmp_path, [known], QUICK)
    changed = property(lambda self: "another")
    monkeypatch.setattr(StimulusSettings, "solver_code", changed)
    assert make_stimuli(tmp_path, [known], QUICK) == made
    with pytest.raises(InputError, match=r"another version of the solver 'sph'.* --replace"):
        make_stimuli(tmp_path, [known, new], QUICK)
    assert read_set(set_folder(tmp_path, QUICK.name)) == made
    anew = make_stimuli(tmp_path, [known, new], QUICK, replace=True)
    assert anew.manifest.solver_code == "another"
    assert len(anew.manifest.stimuli) == 2
