"""Preview stimuli: a still is its film's first picture, work goes on where it stopped."""

import av
import numpy as np
import pytest
from PIL import Image

from pourcast.errors import InputError
from pourcast.stimuli import preview
from pourcast.stimuli.manifest import FOLDER, NAME, is_whole, read_manifest
from pourcast.stimuli.preview import Wanted, make_stimuli


@pytest.fixture(autouse=True)
def short_films(monkeypatch):
    monkeypatch.setattr(preview, "FILM_SECONDS", {"water": 0.3, "honey": 0.5})


def test_a_still_is_its_films_first_picture(ramp, tmp_path):
    manifest = make_stimuli(tmp_path, [Wanted(ramp, "water", film=True)])
    (stimulus,) = manifest.stimuli
    still = np.asarray(Image.open(tmp_path / FOLDER / stimulus.still), float)
    assert still.shape == (900, 600, 3)
    with av.open(str(tmp_path / FOLDER / stimulus.film)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 9
    assert np.abs(frames[0] - still).mean() < 2.0
    assert np.abs(frames[-1] - still).mean() > 2.0


def test_a_still_needs_no_film_and_a_mirrored_scene_mirrors_it(ramp, tmp_path):
    manifest = make_stimuli(tmp_path, [Wanted(ramp, "honey"), Wanted(ramp.mirrored(), "honey")])
    plain, mirrored = (
        np.asarray(Image.open(tmp_path / FOLDER / one.still), float) for one in manifest.stimuli
    )
    assert [one.film for one in manifest.stimuli] == [None, None]
    assert [one.outcome for one in manifest.stimuli] == [None, None]
    assert np.abs(plain[:, ::-1] - mirrored).mean() < 1.0


def test_what_is_there_is_not_made_again_and_what_is_damaged_is(ramp, tmp_path):
    wanted = [Wanted(ramp, "water"), Wanted(ramp, "honey")]
    first = make_stimuli(tmp_path, wanted)
    still = tmp_path / FOLDER / first.stimuli[0].still
    made = still.stat().st_mtime_ns
    told = []
    assert make_stimuli(tmp_path, wanted, lambda *words: told.append(words)) == first
    assert still.stat().st_mtime_ns == made
    assert told == []
    still.write_bytes(b"damaged")
    assert not is_whole(tmp_path, first.stimuli[0])
    assert make_stimuli(tmp_path, wanted) == first
    assert is_whole(tmp_path, first.stimuli[0])


def test_what_two_groups_see_is_made_once(ramp, tmp_path):
    told = []
    wanted = [Wanted(ramp, "water"), Wanted(ramp, "water", film=True), Wanted(ramp, "water")]
    manifest = make_stimuli(tmp_path, wanted, lambda *words: told.append(words))
    assert len(manifest.stimuli) == 1
    assert manifest.stimuli[0].film
    assert told[-1] == ("making stimuli", 1, 1)


def test_the_same_scene_makes_the_same_bytes(ramp, tmp_path):
    wanted = [Wanted(ramp, "water", film=True)]
    assert make_stimuli(tmp_path / "a", wanted) == make_stimuli(tmp_path / "b", wanted)


def test_work_that_is_interrupted_goes_on(ramp, tmp_path):
    wanted = [Wanted(ramp, "water", film=True), Wanted(ramp, "honey", film=True)]

    def interrupt(what, done, total):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_stimuli(tmp_path, wanted, interrupt)
    assert len(read_manifest(tmp_path).stimuli) == 1
    told = []
    assert len(make_stimuli(tmp_path, wanted, lambda *words: told.append(words)).stimuli) == 2
    assert told == [("making stimuli", 0, 1), ("making stimuli", 1, 1)]


def test_a_damaged_list_is_told_of(ramp, tmp_path):
    make_stimuli(tmp_path, [Wanted(ramp, "water")])
    path = tmp_path / FOLDER / NAME
    path.write_text(path.read_text().replace('"still"', '"stil"'))
    with pytest.raises(InputError, match=r"manifest.json: stimuli\[0\].still: Field required"):
        read_manifest(tmp_path)
