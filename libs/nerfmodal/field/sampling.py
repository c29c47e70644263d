"""Where along a ray the field is looked at: stratified (eq 2), then where the coarse weights are (eq 8)."""

import torch
from jaxtyping import Float
from torch import Generator, Tensor


def stratified_samples(
    nears: Float[Tensor, " rays"], fars: Float[Tensor, " rays"], count: int, generator: Generator | None
) -> tuple[Float[Tensor, "rays samples"], Float[Tensor, "rays edges"]]:
    """One sample drawn uniformly from each of `count` equal bins of [near, far] (eq 2), and the bins' edges.

    Without a generator the bins' centres are taken.
    """
    parts = torch.linspace(0.0, 1.0, count + 1, device=nears.device, dtype=nears.dtype)
    edges = nears[:, None] + parts * (fars - nears)[:, None]
    shape = (len(nears), count)
    if generator is None:
        jitter = torch.full(shape, 0.5, device=nears.device, dtype=nears.dtype)
    else:
        jitter = torch.rand(shape, generator=generator, device=nears.device, dtype=nears.dtype)
    return edges[:, :-1] + jitter * (edges[:, 1:] - edges[:, :-1]), edges  # eq 2


def importance_samples(
    edges: Float[Tensor, "rays edges"],
    weights: Float[Tensor, "rays samples"],
    count: int,
    generator: Generator | None,
) -> Float[Tensor, "rays fine"]:
    """`count` samples by inverse transform from the piecewise-constant density of `weights` over the bins (eq 8)."""
    padded = weights + 1e-5  # a ray that met nothing is sampled evenly
    density = padded / padded.sum(-1, keepdim=True)  # eq 8: normalised weights
    cumulative = torch.cat([torch.zeros_like(density[:, :1]), density.cumsum(-1)], dim=-1)
    shape = (len(edges), count)
    if generator is None:
        uniform = (torch.arange(count, device=edges.device, dtype=edges.dtype) + 0.5).div(count).expand(shape)
    else:
        uniform = torch.rand(shape, generator=generator, device=edges.device, dtype=edges.dtype)
    index = torch.searchsorted(cumulative[:, 1:-1].contiguous(), uniform.contiguous(), right=True)
    low, high = edges.gather(1, index), edges.gather(1, index + 1)
    start, share = cumulative.gather(1, index), density.gather(1, index)
    return low + (high - low) * ((uniform - start) / share).clamp(0.0, 1.0)
