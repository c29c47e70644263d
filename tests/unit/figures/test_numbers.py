"""The numbers beside an organ's pictures are those of the result, and of what the pictures draw."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.figures.eigenvalues import covariance_eigenvalues
from nerfmodal.figures.numbers import numbers, write_numbers
from nerfmodal.figures.spectrum import power_spectral_density
from nerfmodal.types import Diagram

from tests.fixtures.scans import FRAMES, LEAF_FREQUENCIES, TIMES, small_result

LEAF = small_result().organs[0]


def test_histories_are_in_millimetres_and_null_where_a_frame_was_lost():
    found = numbers(LEAF)
    histories = np.array(found["coordinates_mm"], dtype=float).T
    seen = LEAF.displacement.valid
    np.testing.assert_allclose(histories[seen], 1e3 * LEAF.model.coordinates[seen], rtol=1e-5)
    assert np.isnan(histories[~seen]).all()
    np.testing.assert_allclose(found["times_s"], TIMES, atol=1e-5)


def test_spectra_peak_at_the_modes_and_are_those_of_the_pictures():
    found = numbers(LEAF)
    frequencies, densities = np.array(found["frequencies_hz"]), np.array(found["densities_mm2_per_hz"])
    np.testing.assert_allclose(frequencies[densities.argmax(axis=1)], LEAF_FREQUENCIES, atol=0.1)
    values = np.where(LEAF.displacement.valid, 1e3 * LEAF.model.coordinates[:, 0], np.nan)
    drawn = power_spectral_density(TIMES, values, LEAF.displacement.frame_rate)
    np.testing.assert_allclose(densities[0], drawn[1], rtol=1e-5)


def test_eigenvalues_sum_to_their_sum_and_say_how_many_are_kept():
    found = numbers(LEAF)["eigenvalues"]
    every = covariance_eigenvalues(LEAF)
    np.testing.assert_allclose(found["mean_squares_mm2"], every[:21], rtol=1e-5)
    assert found["sum_mm2"] == pytest.approx(every.sum(), rel=1e-5)
    assert found["kept"] == LEAF.reduction.scores.shape[1]


def test_poles_of_a_diagram_are_listed_and_none_is_null():
    assert numbers(LEAF)["stabilisation"] is None
    diagram = Diagram(
        orders=np.array([2, 4, 4]),
        frequencies=np.array([2.2, 2.17, 9.0]),
        damping_ratios=np.array([0.02, 0.01, 0.1]),
        stable=np.array([False, True, False]),
    )
    found = numbers(replace(LEAF, opinions=(replace(LEAF.opinions[0], diagram=diagram),)))["stabilisation"]
    assert (found["orders"], found["stable"]) == ([2, 4, 4], [False, True, False])
    assert found["frequencies_hz"] == [2.2, 2.17, 9.0]


def test_an_organ_without_modes_has_empty_lists(tmp_path: Path):
    model = LEAF.model
    none = replace(
        model,
        frequencies=np.empty(0),
        frequency_stds=np.empty(0),
        damping_ratios=np.empty(0),
        damping_stds=np.empty(0),
        mode_shapes=np.empty((*model.mode_shapes.shape[:2], 0)),
        coordinates=np.empty((FRAMES, 0)),
        quality=(),
    )
    path = write_numbers(replace(LEAF, model=none, reduction=None), tmp_path / "leaf.json")
    found = json.loads(path.read_text())
    assert found["coordinates_mm"] == found["frequencies_hz"] == found["densities_mm2_per_hz"] == []
    assert found["eigenvalues"] is None
