"""Flat pictures: liquid where it is, in its colour, in front of nothing solid."""

import numpy as np
import pytest

from pourcast.pictures.video import write_film
from pourcast.scenes.liquids.registry import WATER, resolve_liquid
from pourcast.stimuli.recording import FULL, Moment, RecordedPour
from pourcast.stimuli.renderers import preview
from pourcast.stimuli.renderers.preview import Preview
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann
from pourcast.stimuli.solvers.sph import ParticleEngine
from tests.make import random_scenes
from tests.yardstick import ratio


def still(scene, name="water"):
    liquid = resolve_liquid(name, scene)
    pour = LatticeBoltzmann(resolution=60).pour(scene, liquid, 1 / 30)
    return drawn(scene, pour, liquid)


def drawn(scene, pour, liquid=WATER):
    return Preview(width=200).picture_maker(scene, liquid, pour)(0).astype(float)


def coloured(image, liquid):
    """Pixels of the liquid's hue."""
    red, _, blue = np.moveaxis(image, 2, 0)
    return (blue - red > 40) if liquid == "water" else (red - blue > 90)


@pytest.mark.parametrize("liquid", ["water", "honey"])
def test_the_liquid_is_seen_where_it_starts(ramp, liquid):
    image = still(ramp, liquid)
    assert image.shape == (300, 200, 3)
    rows, columns = np.nonzero(coloured(image, liquid)[:150])
    x, y = ramp.liquid.centre
    assert columns.mean() / 200 == pytest.approx(x, abs=0.01)
    assert 1.5 - rows.mean() / 200 == pytest.approx(y, abs=0.01)
    assert np.ptp(columns) / 200 == pytest.approx(ramp.liquid.diameter, abs=0.03)


def test_particles_are_seen_where_the_cells_are(ramp):
    pour = ParticleEngine().pour(ramp, WATER, 1 / 30)
    image = drawn(ramp, pour)
    one, other = coloured(image, "water"), coloured(still(ramp), "water")
    assert (one & other).sum() / (one | other).sum() > 0.75


def test_a_mirrored_scene_makes_the_mirrored_picture(ramp):
    # Lit from the left, bevels are not mirrored.
    assert np.abs(still(ramp)[:, ::-1] - still(ramp.mirrored())).mean() < 2.0


def test_solids_hide_the_liquid_and_are_no_part_of_it(ramp):
    cells = np.full((20, 30, 3), FULL, np.uint8)
    moment = Moment(cells, np.zeros((0, 4), np.float32))
    pour = RecordedPour(
        (moment,), 0.05, (0.0, 0.0, 0.0), np.ones(cells.shape, np.float32), 0.5, 0.0
    )
    image = drawn(ramp, pour)
    wet = coloured(image, "water")
    # The middle of the ramp, and of the divider.
    assert not wet[300 - 156 : 300 - 148, 55:70].any()
    assert not wet[280:290, 98:102].any()
    assert wet.mean() > 0.8


def test_what_a_solid_changes_lies_around_it(monkeypatch):
    scenes = random_scenes(2)
    around = [preview._solids(scene, (300, 450)) for scene in scenes]
    monkeypatch.setattr(preview, "_around", lambda *_: (slice(0, 450), slice(0, 300)))
    for (image, solid), scene in zip(around, scenes, strict=True):
        whole, everywhere = preview._solids(scene, (300, 450))
        # Corners are rounded to parts of pixels where they are drawn.
        assert (image == whole).mean() > 0.95
        assert np.abs(image - whole).mean() < 1e-4
        assert np.abs(solid - everywhere).mean() < 1e-4


def test_a_film_takes_little_more_than_its_coding(ramp, tmp_path):
    # Measured: 2.1 times the coding of pictures that are there already.
    pour = ParticleEngine().pour(ramp, WATER, 1.0)
    picture = Preview(width=600).picture_maker(ramp, WATER, pour)
    pictures = [picture(k) for k in range(30)]
    film = tmp_path / "film.mp4"
    assert ratio(
        lambda: write_film(film, picture, 30), lambda: write_film(film, pictures.__getitem__, 30)
    ) < 5.0  # fmt: skip
