"""Films: MP4 and WebM for browsers, GIF for pages that show no films."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image

FRAME_RATE = 30
"""Pictures a second, in every film; the paper's."""

Picture = Callable[[int], NDArray[np.uint8]]
"""From a frame's number to red, green, blue, shape [height, width, 3]."""

_CODECS: dict[str, tuple[str, dict[str, str]]] = {
    # With macroblock-tree rate control, x264's AVX-512 code makes other bytes now and then.
    ".mp4": ("libx264", {"crf": "18", "x264-params": "mbtree=0"}),
    # One thread, so that the same pictures make the same bytes on any machine.
    ".webm": (
        "libvpx-vp9",
        {"crf": "24", "b": "0", "cpu-used": "5", "deadline": "good", "threads": "1"},
    ),
}


def write_film(
    path: Path, picture: Picture, count: int, metadata: Mapping[str, str] | None = None
) -> None:
    """Write a silent film at 30 Hz; the same pictures make the same bytes.

    Parameters
    ----------
    path
        A name that ends in .mp4 (H.264) or .webm (VP9).
    picture
        Draws a frame.
    count
        Number of frames; the film lasts exactly so many thirtieths of a second.
    metadata
        Words that are kept in the file, such as `title` and `comment`.
    """
    codec, options = _CODECS[path.suffix]
    flags = {"movflags": "faststart"} if path.suffix == ".mp4" else {}
    with av.open(str(path), "w", options={**flags, "fflags": "+bitexact"}) as container:
        container.metadata.update(metadata or {})
        stream: Any = container.add_stream(codec, rate=Fraction(FRAME_RATE))
        stream.pix_fmt = "yuv420p"
        stream.options = options
        for k in range(count):
            image = picture(k)
            # 4:2:0 chroma wants even sizes.
            even = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
            if k == 0:
                stream.height, stream.width = even.shape[:2]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def write_gif(path: Path, picture: Picture, count: int, *, stride: int) -> None:
    """Write an animation that is shown again and again.

    Parameters
    ----------
    path
        The .gif file.
    picture
        Draws a frame.
    count
        Number of frames.
    stride
        How many thirtieths of a second each is shown.
    """
    # One palette for all frames, or the colours flicker.
    frames = [Image.fromarray(picture(k)) for k in range(count)]
    palette = frames[count // 2].quantize(128)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    duration = 1000 * stride // FRAME_RATE
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=duration, loop=0)
