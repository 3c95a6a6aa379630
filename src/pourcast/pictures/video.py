"""Films: MP4 and WebM for browsers, GIF for pages that show no films."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pourcast.progress import Progress, no_progress

FRAME_RATE = 30
"""Pictures a second, in every film; the paper's."""

T = TypeVar("T")

Picture = Callable[[int], NDArray[np.uint8]]
"""From a frame's number to red, green, blue, shape [height, width, 3]."""

_CODECS: dict[str, tuple[str, dict[str, str]]] = {
    # With macroblock-tree rate control, x264's AVX-512 code makes other bytes now and then.
    # Slower presets take twice as long to make a film smaller by a twentieth.
    ".mp4": ("libx264", {"crf": "18", "preset": "veryfast", "x264-params": "mbtree=0"}),
    ".webm": ("libvpx-vp9", {"crf": "24", "b": "0", "cpu-used": "5", "deadline": "good"}),
}

_CODING_THREADS = {".mp4": 4, ".webm": 1}
"""Not the number of cores, on which the bytes of a film would depend."""


def write_film(
    path: Path,
    picture: Picture,
    count: int,
    metadata: Mapping[str, str] | None = None,
    *,
    threads: int = 1,
    progress: Progress = no_progress,
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
    threads
        How many frames are drawn at once.
    progress
        Called with the frames written and how many there are.
    """
    codec, options = _CODECS[path.suffix]
    flags = {"movflags": "faststart"} if path.suffix == ".mp4" else {}

    def frame(number: int) -> av.VideoFrame:
        image = picture(number)
        # 4:2:0 chroma wants even sizes.
        even = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
        drawn = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
        return drawn.reformat(format="yuv420p")

    with av.open(str(path), "w", options={**flags, "fflags": "+bitexact"}) as container:
        container.metadata.update(metadata or {})
        stream: Any = container.add_stream(codec, rate=Fraction(FRAME_RATE))
        stream.pix_fmt = "yuv420p"
        stream.options = options
        stream.thread_type = "FRAME"
        stream.thread_count = _CODING_THREADS[path.suffix]
        for number, drawn in enumerate(_in_order(frame, count, threads)):
            if number == 0:
                stream.height, stream.width = drawn.height, drawn.width
            container.mux(stream.encode(drawn))
            progress(number + 1, count)
        container.mux(stream.encode())


def write_gif(
    path: Path,
    picture: Picture,
    count: int,
    *,
    stride: int,
    threads: int = 1,
    progress: Progress = no_progress,
) -> None:
    """Write an animation that is shown again and again; the same pictures make the same bytes.

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
    threads
        How many frames are drawn at once.
    progress
        Called with the frames drawn and how many there are.
    """
    # One palette for all frames, or the colours flicker.
    palette = Image.fromarray(picture(count // 2)).quantize(128)

    def indexed() -> Iterator[Image.Image]:
        # Not in the threads: a palette remembers the colours that it was asked for.
        for number, drawn in enumerate(_in_order(picture, count, threads)):
            yield Image.fromarray(drawn).quantize(palette=palette, dither=Image.Dither.NONE)
            progress(number + 1, count)

    frames = indexed()
    duration = 1000 * stride // FRAME_RATE
    next(frames).save(path, save_all=True, append_images=frames, duration=duration, loop=0)


def _in_order(draw: Callable[[int], T], count: int, threads: int) -> Iterator[T]:
    """Frames in their order, drawn a little ahead by threads of their own."""
    with ThreadPoolExecutor(threads) as pool:
        ahead: deque[Future[T]] = deque()
        for number in range(count):
            ahead.append(pool.submit(draw, number))
            if len(ahead) > 2 * threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
