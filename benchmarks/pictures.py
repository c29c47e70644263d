"""How well a trained field shows the plant: PSNR where the plant, or a moved part of it, truly is."""

import numpy as np
from jaxtyping import Bool, UInt8
from nerfmodal import field
from nerfmodal.field.course import psnr
from nerfmodal.types import Checkpoint, Frame
from scipy.ndimage import binary_dilation

from benchmarks.films import Film
from benchmarks.truth import TrueSurface

AROUND = 7
"""Side of the square by which the plant's true outline is widened, pixels."""


def plant_pixels(film: Film, index: int) -> Bool[np.ndarray, "cameras height width"]:
    """Pixels at, or close to, the plant as it is in frame `index` or was in frame 0."""
    rig = film.frame(0).rig
    masks = [TrueSurface(film.plant, film.vertices(one)).seen_by(rig)[1] for one in {0, index}]
    return np.asarray(binary_dilation(np.logical_or.reduce(masks), np.ones((1, AROUND, AROUND), dtype=bool)))


def plant_psnr(
    checkpoint: Checkpoint,
    frame: Frame,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"],
    mask: Bool[np.ndarray, "cameras height width"],
) -> float:
    """Peak signal-to-noise ratio of the pixels in `mask`, dB."""
    pixels = np.argwhere(mask).astype(np.int32)
    colors, opacities, _, _ = field.looker(checkpoint, frame)(pixels)
    behind = backgrounds[mask] / 255.0
    shown = colors * opacities[:, None] + (1 - opacities[:, None]) * behind
    return psnr(float(np.mean((np.clip(shown, 0, 1) - frame.images[mask] / 255.0) ** 2)))
