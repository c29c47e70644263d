"""Equations 1 to 8 of the paper, held by closed forms and by slow loops that follow the print (docs/equations.md)."""

import math

import numpy as np
import pytest
import torch
from nerfmodal.field.encodings import DIRECTION_BANDS, POSITION_BANDS, positional_encoding, spherical_angles
from nerfmodal.field.rendering import composite, composite_weights, intervals
from nerfmodal.field.sampling import importance_samples, stratified_samples

GENERATOR_SEED = 4


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(GENERATOR_SEED)


def test_eq_1_a_slab_of_constant_density_and_colour():
    """C = c (1 - exp(-sigma L)), whatever the samples: the quadrature is exact where nothing varies."""
    t, _ = stratified_samples(torch.zeros(5), torch.full((5,), 2.0), 64, generator())
    delta = intervals(t, torch.full((5,), 2.0))
    weights, left = composite_weights(torch.full((5, 64), 1.3), delta)
    color = composite(weights, torch.full((5, 64, 3), 0.7))
    length = 2.0 - t[:, 0]
    torch.testing.assert_close(color[:, 0], 0.7 * (1 - torch.exp(-1.3 * length)))
    torch.testing.assert_close(left, torch.exp(-1.3 * length))


def test_eq_1_the_quadrature_converges_to_the_integral_of_a_varying_density():
    """sigma(t) = t on [0, 2], colour t: C = ∫ t · t exp(-t²/2) dt."""
    t, _ = stratified_samples(torch.zeros(1), torch.tensor([2.0]), 4000, None)
    weights, _ = composite_weights(t, intervals(t, torch.tensor([2.0])))
    fine = np.linspace(0, 2, 200_001)
    integrand = fine * fine * np.exp(-(fine**2) / 2)
    expected = float(((integrand[1:] + integrand[:-1]) / 2 * np.diff(fine)).sum())
    assert float(composite(weights, t[..., None])) == pytest.approx(expected, abs=1e-3)


def test_eq_2_one_sample_in_every_bin_and_uniform_in_it():
    t, edges = stratified_samples(torch.full((4000,), 1.0), torch.full((4000,), 3.0), 8, generator())
    share = (t - edges[:, :-1]) / (edges[:, 1:] - edges[:, :-1])
    assert float(share.min()) >= 0
    assert float(share.max()) <= 1
    assert share.mean(dim=0).numpy() == pytest.approx(np.full(8, 0.5), abs=0.02)
    assert share.var(dim=0).numpy() == pytest.approx(np.full(8, 1 / 12), rel=0.05)


def test_eq_3_and_8_weights_are_those_of_the_printed_sums():
    density = torch.rand(3, 12, generator=generator()) * 4
    t = torch.linspace(0, 1, 13)[:-1].expand(3, 12)
    delta = intervals(t, torch.ones(3))
    weights, left = composite_weights(density, delta)
    for ray in range(3):
        for i in range(12):
            before = sum(float(density[ray, j] * delta[ray, j]) for j in range(i))
            expected = math.exp(-before) * (1 - math.exp(-float(density[ray, i] * delta[ray, i])))
            assert float(weights[ray, i]) == pytest.approx(expected, rel=1e-4, abs=1e-7)
    torch.testing.assert_close(weights.sum(-1) + left, torch.ones(3))


@pytest.mark.parametrize(("coordinates", "bands"), [(1, 3), (3, POSITION_BANDS), (2, DIRECTION_BANDS)])
def test_eq_4_to_7_each_coordinate_in_sines_and_cosines_of_doubling_frequency(coordinates: int, bands: int):
    p = torch.rand(5, coordinates, generator=generator(), dtype=torch.float64) * 2 - 1
    encoded = positional_encoding(p, bands)
    printed = [
        [f(2**k * math.pi * float(value)) for value in row for k in range(bands) for f in (math.sin, math.cos)]
        for row in p
    ]
    assert encoded.shape == (5, 2 * bands * coordinates)  # eq 5: 2 L features a coordinate
    np.testing.assert_allclose(encoded.numpy(), printed, atol=1e-10)


def test_eq_7_angles_of_a_direction_are_scaled_to_the_unit_interval():
    directions = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    expected = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [0.5, 1.0]])
    torch.testing.assert_close(spherical_angles(directions), expected)


def test_eq_8_fine_samples_follow_the_weights():
    edges = torch.linspace(0, 4, 5).expand(20_000, 5).contiguous()
    weights = torch.tensor([0.1, 0.6, 0.0, 0.3]).expand(20_000, 4).contiguous()
    fine = importance_samples(edges, weights, 4, generator())
    share = torch.histc(fine, bins=4, min=0, max=4) / fine.numel()
    assert share.numpy() == pytest.approx([0.1, 0.6, 0.0, 0.3], abs=0.01)
