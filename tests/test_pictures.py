import av
import numpy as np

from pourcast.pictures import _yuv420


def test_colours_survive_the_way_to_yuv_and_back():
    rng = np.random.default_rng(0)
    blocks = rng.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    image = np.repeat(np.repeat(blocks, 2, axis=0), 2, axis=1)
    planes = _yuv420(image)
    assert planes.shape == (15, 14)
    back = av.VideoFrame.from_ndarray(planes, format="yuv420p").to_ndarray(format="rgb24")
    assert np.abs(back.astype(int) - image).mean() < 3
    grey = _yuv420(np.full((4, 4, 3), 255, np.uint8))
    assert (grey[:4] == 235).all()
    assert (grey[4:] == 128).all()
