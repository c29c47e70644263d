"""Positional encoding (eq 4-7): a coordinate becomes sines and cosines of doubling frequencies.

Angles are in radians; positions are scaled to [-1, 1] by the caller (the paper's p).
Tancik et al. 2020, Vaswani et al. 2017.
"""

import torch
from jaxtyping import Float
from torch import Tensor

POSITION_BANDS = 10
DIRECTION_BANDS = 4


def positional_encoding(p: Float[Tensor, "*batch coordinates"], bands: int) -> Float[Tensor, "*batch features"]:
    """Encode each coordinate in `bands` frequencies.

    Returns
    -------
    Tensor (..., 2 * bands * coordinates)
        For each coordinate in turn: sin and cos of 2^k pi p, k = 0 .. bands - 1.
    """
    frequencies = 2.0 ** torch.arange(bands, device=p.device, dtype=p.dtype) * torch.pi
    angles = p[..., None] * frequencies
    encoded = torch.stack([torch.sin(angles), torch.cos(angles)], dim=-1)  # eq 4, 5
    return encoded.flatten(-3)  # eq 6, 7: one coordinate after the other


def spherical_angles(directions: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
    """Polar angle and azimuth of unit vectors, both divided by pi: the (theta, phi) of eq 7 in [-1, 1]."""
    theta = torch.acos(directions[..., 2].clamp(-1.0, 1.0))
    phi = torch.atan2(directions[..., 1], directions[..., 0])
    return torch.stack([theta, phi], dim=-1) / torch.pi
