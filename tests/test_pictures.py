import av
import numpy as np

from pourcast.video import write_film


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
