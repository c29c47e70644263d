"""Volume rendering by quadrature (eq 1, 3; Max 1995). Takes densities, knows no network.

C(r) = sum_i T_i (1 - exp(-sigma_i delta_i)) c_i,   T_i = exp(-sum_(j<i) sigma_j delta_j)
"""

import torch
from jaxtyping import Float
from torch import Tensor


def intervals(t: Float[Tensor, "rays samples"], fars: Float[Tensor, " rays"]) -> Float[Tensor, "rays samples"]:
    """delta_i = t_(i+1) - t_i (eq 3); the last interval reaches to the far bound."""
    return torch.diff(torch.cat([t, fars[:, None]], dim=-1), dim=-1).clamp(min=0.0)


def composite_weights(
    density: Float[Tensor, "rays samples"], delta: Float[Tensor, "rays samples"]
) -> tuple[Float[Tensor, "rays samples"], Float[Tensor, " rays"]]:
    """w_i = T_i (1 - exp(-sigma_i delta_i)) (eq 8), and the transmittance that is left behind the last sample."""
    thickness = density * delta
    total = torch.cumsum(thickness, dim=-1)
    transmittance = torch.exp(-(total - thickness))  # eq 3: T_i
    return transmittance * -torch.expm1(-thickness), torch.exp(-total[..., -1])  # eq 3


def composite(
    weights: Float[Tensor, "rays samples"], values: Float[Tensor, "rays samples channels"]
) -> Float[Tensor, "rays channels"]:
    """sum_i w_i c_i (eq 3)."""
    return (weights[..., None] * values).sum(dim=-2)


def depth_at(
    weights: Float[Tensor, "rays samples"], t: Float[Tensor, "rays samples"], level: Float[Tensor, " rays"]
) -> Float[Tensor, " rays"]:
    """Distance at which the accumulated opacity passes the ray's `level`; 0 where it never does, or that is 0."""
    reached = (weights.cumsum(dim=-1) >= level[:, None]) & (level > 0)[:, None]
    first = reached.int().argmax(dim=-1, keepdim=True)
    return torch.where(reached.any(dim=-1), t.gather(-1, first)[:, 0], torch.zeros_like(t[:, 0]))
