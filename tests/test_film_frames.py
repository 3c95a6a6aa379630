"""Frames of films: as their figure would be drawn, the same on any number of cores, and fast."""

import os
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from pourcast.pictures.cover import liquid_cover
from pourcast.pictures.panels import draw_pour, film_figure
from pourcast.pictures.predictions import PredictedPaths, PredictedPour
from pourcast.pictures.video import write_film, write_gif
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene import Box, LiquidStart, Scene
from tests.yardstick import ratio

PATHS = PredictedPaths("paths", 0.5, WATER.rgb, (np.array([[0.5, 1.3], [0.5, 0.0], [0.7, 0.0]]),))


def falling(scene, frame_count, *, look="liquid"):
    """A disc of particles that falls, and spreads over the floor from wall to wall."""
    rng = np.random.default_rng(0)
    start = np.array([*scene.liquid.centre, 0.0]) + rng.normal(0.0, 0.03, (100, 3))
    end = rng.uniform(0.0, (scene.box.width, 0.1 * scene.box.height, 0.1), (100, 3))
    part = np.linspace(0.0, 1.0, frame_count)[:, None, None]
    frames = ((1.0 - part) * start + part * end).astype(np.float32)
    if look == "cells":  # of a grid: none twice
        frames[...] = 0.03 * np.argwhere(np.ones((10, 10, 1))) + 0.09
        frames[..., 1] += 0.3 * np.arange(frame_count)[::-1, None]
    return PredictedPour("pour", 0.5, WATER.rgb, frames, 0.03, look)


def figures_frame(scene, predictions, number):
    """A frame as matplotlib draws it."""
    film = film_figure(scene, predictions)
    for flood, pour in film.floods:
        flood.set_visible(False)
        draw_pour(flood.axes, scene, pour, min(number, len(pour.frames) - 1))
    canvas = FigureCanvasAgg(film.figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].astype(float)


def film_of(scene, frame_count):
    return film_figure(scene, [falling(scene, frame_count), PATHS, falling(scene, frame_count)])


@pytest.mark.parametrize("look", ["liquid", "marbles", "cells"])
def test_a_frame_is_what_the_figure_would_be(ramp, look):
    pours = [falling(ramp, 5, look=look), falling(ramp, 3, look=look)]
    pours[1] = replace(pours[1], colour=(0.9, 0.6, 0.1))
    picture = film_figure(ramp, [pours[0], PATHS, pours[1]]).picture_maker()
    for number in (0, 2, 4):
        drawn = figures_frame(ramp, [pours[0], PATHS, pours[1]], number)
        # Measured: 0.01 for marbles, up to 0.5 for a liquid, whose edges are sharper here.
        assert np.abs(picture(number) - drawn).mean() < (0.8 if look == "liquid" else 0.05)
        assert np.abs(picture(number) - picture(1).astype(float)).mean() > 1.0


@pytest.mark.parametrize(("width", "height"), [(3.0, 0.5), (0.3, 1.2), (9.0, 9.0)])
def test_boxes_of_any_size_are_drawn(width, height):
    scene = Scene(
        id="box", box=Box(width=width, height=height),
        goal=Basins(divider_x=width / 2, divider_width=width / 10, divider_height=height / 10),
        liquid=LiquidStart(centre=(width / 2, 0.8 * height)),
    )  # fmt: skip
    pour = falling(scene, 2)
    away = np.concatenate([pour.frames, pour.frames[-1:] + 100.0])
    picture = film_figure(scene, [replace(pour, frames=away)]).picture_maker()
    assert np.abs(picture(0) - figures_frame(scene, [pour], 0)).mean() < 0.6
    assert (picture(0) != picture(1)).any()
    empty = figures_frame(scene, [replace(pour, spacing=1e-9)], 0)
    assert np.array_equal(picture(2), empty)


def test_a_liquid_is_as_thick_at_walls_as_elsewhere():
    rows, columns = np.mgrid[2:40:4, 2:60:4]
    places = np.stack([rows.ravel(), columns.ravel()], axis=1).astype(float)
    opacity, part = liquid_cover(places, 2.0, (40, 60))
    assert part == (slice(0, 40), slice(0, 60))
    assert np.ptp(opacity) == 0


def test_only_what_may_be_covered_is_returned():
    opacity, (rows, columns) = liquid_cover(np.array([[20.5, 33.5]]), 2.0, (40, 60), block=4)
    assert [edge % 4 for edge in (rows.start, rows.stop, columns.start, columns.stop)] == [0] * 4
    whole = np.zeros((40, 60))
    whole[rows, columns] = opacity
    assert np.argwhere(whole).mean(axis=0).tolist() == [20.0, 33.0]
    assert whole.max() == round(0.85 * 255)
    assert not liquid_cover(np.array([[50.0, 5.0], [np.nan, 5.0]]), 2.0, (40, 60))[0].any()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores can't be chosen here")
@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_film_has_the_same_bytes_on_any_number_of_cores(ramp, tmp_path, suffix):
    cores, made = os.sched_getaffinity(0), set()
    try:
        for threads in (1, 2):
            os.sched_setaffinity(0, sorted(cores)[:threads])
            path = tmp_path / f"{threads}{suffix}"
            picture = film_of(ramp, 6).picture_maker()
            if suffix == ".gif":
                write_gif(path, picture, 8, stride=2, threads=threads)
            else:
                write_film(path, picture, 8, threads=threads)
            made.add(path.read_bytes())
    finally:
        os.sched_setaffinity(0, cores)
    assert len(made) == 1


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_frames_are_drawn_a_few_ahead_and_told_of_in_order(tmp_path, suffix):
    drawn, told = [], []

    def picture(number):
        drawn.append(number)
        return np.full((40, 60, 3), 5 * number, np.uint8)

    def progress(done, total):
        told.append((done, total))
        assert len(drawn) <= done + 2 * 2 + 2

    if suffix == ".gif":
        write_gif(tmp_path / "a.gif", picture, 30, stride=2, threads=2, progress=progress)
    else:
        write_film(tmp_path / "a.mp4", picture, 30, threads=2, progress=progress)
    assert told == [(k, 30) for k in range(1, 31)]


def test_a_frame_that_fails_ends_the_film(tmp_path):
    def picture(number):
        if number == 7:
            raise ValueError("no such frame")
        return np.zeros((40, 60, 3), np.uint8)

    with pytest.raises(ValueError, match="no such frame"):
        write_film(tmp_path / "a.mp4", picture, 30, threads=2)


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_film_takes_little_more_than_its_coding(ramp, tmp_path, suffix):
    picture = film_of(ramp, 20).picture_maker()
    pictures = [picture(k) for k in range(20)]

    def written(source):
        if suffix == ".gif":
            write_gif(tmp_path / "a.gif", source, 20, stride=1)
        else:
            write_film(tmp_path / "a.mp4", source, 20)

    # Measured: 1.5 to 2; 10 (GIF) and 5 where matplotlib draws each frame.
    assert ratio(lambda: written(picture), lambda: written(pictures.__getitem__)) < 3.0
