"""Display values and linear light (IEC 61966-2-1)."""

import numpy as np
from jaxtyping import Float, UInt8


def to_srgb(linear: Float[np.ndarray, "*pixels 3"]) -> UInt8[np.ndarray, "*pixels 3"]:
    """Display values of linear light, which is cut at 0 and 1."""
    light = np.clip(linear, 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return np.round(255 * curve).astype(np.uint8)


def to_linear(picture: UInt8[np.ndarray, "*pixels 3"]) -> Float[np.ndarray, "*pixels 3"]:
    """Linear light in [0, 1] of display values."""
    values = np.arange(256) / 255.0
    table = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return np.asarray(table[picture])
