"""Pictures as films: MP4 (H.264, plays everywhere) and GIF (shows everywhere)."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from jaxtyping import UInt8
from PIL import Image

FRAMES_PER_SECOND = 20
"""A GIF counts in hundredths of a second: 5 of them."""
ENCODER = {"crf": "23", "preset": "veryfast", "threads": "1"}
"""x264: a rate factor of 18 cannot be told from the original, 28 shows blocks."""
COLORS = 128


def write_mp4(frames: UInt8[np.ndarray, "frames height width 3"], path: Path) -> None:
    """Write H.264 in an MP4 that starts to play before it is loaded whole; width and height must be even."""
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", rate=Fraction(FRAMES_PER_SECOND), options=ENCODER)
        stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], "yuv420p"
        for picture in frames:
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def write_gif(frames: UInt8[np.ndarray, "frames height width 3"], path: Path) -> None:
    """Write a GIF that repeats for ever, all frames with the palette that suits the first, middle and last."""
    samples = np.concatenate([frames[0], frames[len(frames) // 4], frames[len(frames) // 2]])
    palette = Image.fromarray(samples).quantize(COLORS)
    pictures = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    duration = 1000 // FRAMES_PER_SECOND
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=duration, loop=0, disposal=1)
