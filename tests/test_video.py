"""Films: exact length and rate, silent, with their metadata, the same bytes."""

import av
import numpy as np
import pytest

from pourcast.pictures.video import write_film, write_gif


def picture(number):
    image = np.zeros((61, 40, 3), np.uint8)
    image[number : number + 10] = (40, 120, 200)
    return image


@pytest.mark.parametrize(("suffix", "codec"), [(".mp4", "h264"), (".webm", "vp9")])
def test_films_last_exactly_as_long_as_they_should(tmp_path, suffix, codec):
    path = tmp_path / f"film{suffix}"
    write_film(path, picture, 45, {"title": "a scene", "comment": '{"seed": 0}'})
    with av.open(str(path)) as film:
        (stream,) = film.streams
        assert (stream.codec.name, stream.average_rate) == (codec, 30)
        assert film.duration == 1_500_000
        words = {key.lower(): value for key, value in film.metadata.items()}
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert words["title"] == "a scene"
    assert words["comment"] == '{"seed": 0}'
    assert len(frames) == 45
    assert frames[0].shape == (60, 40, 3)
    assert np.abs(frames[30].astype(float) - picture(30)[:60]).mean() < 8.0


def test_the_same_pictures_make_the_same_webm(tmp_path):
    paths = [tmp_path / f"{name}.webm" for name in "ab"]
    for path in paths:
        write_film(path, picture, 20)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_an_animation_has_all_frames(tmp_path):
    write_gif(tmp_path / "film.gif", picture, 6, stride=2)
    with av.open(str(tmp_path / "film.gif")) as film:
        assert sum(1 for _ in film.decode(video=0)) == 6


def random_pictures(count, block):
    """Pictures of 104 x 130 pixels, in squares of random colours."""
    rng = np.random.default_rng(0)
    squares = rng.integers(0, 256, (count, 104 // block, 130 // block, 3), dtype=np.uint8)
    return np.repeat(np.repeat(squares, block, axis=1), block, axis=2)


def test_the_same_pictures_make_the_same_film(tmp_path):
    pictures, made, clutter = random_pictures(40, 13), set(), []
    for k in range(12):
        # So that memory holds other things each time.
        clutter.append(np.full(300_007 * (k % 5 + 1), k + 1, np.uint8))
        path = tmp_path / f"{k}.mp4"
        write_film(path, lambda number: pictures[number], len(pictures))
        made.add(path.read_bytes())
        if k % 3 == 2:
            clutter.clear()
    assert len(made) == 1


def test_colours_survive_the_way_into_a_film_and_back(tmp_path):
    pictures = random_pictures(3, 26)
    write_film(tmp_path / "film.mp4", lambda number: pictures[number], len(pictures))
    with av.open(str(tmp_path / "film.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 3
    assert np.abs(frames[0].astype(int) - pictures[0]).mean() < 3
