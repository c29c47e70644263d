"""Equation 9: the loss of a batch is the squared error of coarse and fine colours together."""

import numpy as np
import pytest
import torch
from nerfmodal.field.mlp import MlpField, MlpSettings
from nerfmodal.field.mlp_training import squared_error


def test_coarse_and_fine_errors_add_up() -> None:
    truth = torch.tensor([[0.0, 0.5, 1.0], [1.0, 1.0, 1.0]])
    coarse, fine = truth + 0.1, truth - 0.2
    assert float(squared_error(coarse, fine, truth)) == pytest.approx(6 * 0.1**2 + 6 * 0.2**2, rel=1e-6)


def test_a_state_gives_back_its_field() -> None:
    settings = MlpSettings(width=16, coarse_samples=4, fine_samples=4, rays_per_batch=32)
    field = MlpField(-np.ones(3), np.ones(3), settings, seed=3)
    again = MlpField.of(field.state())
    assert again.settings == settings
    for one, other in zip(field.fine.parameters(), again.fine.parameters(), strict=True):
        assert torch.equal(one, other)
