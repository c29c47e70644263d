"""Ambient records through the subspace method, and the kind of excitation recognised from what was found."""

import numpy as np
import pytest
from nerfmodal.bounds import ambient_deviations
from nerfmodal.identify import ambient, identify
from nerfmodal.identify.ambient import pyoma_poles
from nerfmodal.identify.excitation import excitation_of, recognise
from nerfmodal.identify.metrics import mac
from nerfmodal.identify.readings import Record
from nerfmodal.identify.reduction import principal_axes
from nerfmodal.identify.subspace import even_scores, read_poles, read_subspace, stabilise
from nerfmodal.identify.whittle import refine_resonance
from nerfmodal.spec import IdentificationSpec
from nerfmodal.types import Reason, Verdict

from tests.fixtures.ambient import FREQUENCIES, ambient_record, displacement_of

TIMES = np.arange(90) / 30.0


@pytest.mark.parametrize("seed", [0, 1])
def test_a_minute_of_wind_holds_all_modes(seed: int) -> None:
    displacement, shapes = ambient_record(60.0, 0.02, seed)
    result = identify(displacement, IdentificationSpec(), seed=0)
    model = result.model
    accepted = [index for index, quality in enumerate(model.quality) if quality.verdict is Verdict.ACCEPTED]
    assert len(accepted) == 3
    for index, frequency, shape in zip(accepted, FREQUENCIES, shapes, strict=True):
        frequency_sd, damping_sd = ambient_deviations(frequency, 0.02, 60.0)
        assert model.frequencies[index] == pytest.approx(frequency, abs=4 * frequency_sd)
        assert model.damping_ratios[index] == pytest.approx(0.02, abs=4 * damping_sd)
        assert mac(model.mode_shapes[:, 0, index], shape) > 0.99
    assert excitation_of([result], "auto") == "ambient"
    methods = {"damped_sinusoids", "complexity_pursuit", "subspace", "frequency_domain"}
    assert {opinion.method for opinion in result.opinions} == methods
    assert all("frequency_domain" in model.quality[index].agreeing for index in accepted)
    diagram = next(opinion.diagram for opinion in result.opinions if opinion.method == "subspace")
    columns = np.abs(np.subtract.outer(diagram.frequencies[diagram.stable], FREQUENCIES)) < 0.02 * np.array(FREQUENCIES)
    assert columns.sum(axis=0).min() >= 5  # a column of stable poles stands at every mode


def test_three_seconds_of_wind_are_never_accepted_as_ambient() -> None:
    displacement, _ = ambient_record(3.0, 0.02, 0)
    model = identify(displacement, IdentificationSpec(excitation="ambient"), seed=0).model
    doubts = [quality for quality in model.quality if Reason.RECORD_TOO_SHORT in quality.reasons]
    assert len(doubts) == len(model.quality)
    assert all(quality.verdict is Verdict.DOUBTFUL for quality in doubts)


def test_our_own_subspace_method_and_pyoma_have_the_same_poles() -> None:
    displacement, _ = ambient_record(60.0, 0.02, 2)
    record = Record(displacement=displacement, axes=principal_axes(displacement.coefficients, displacement.basis))
    ours = read_subspace(record, 4, max_modes=8)
    theirs = read_poles(
        record, even_scores(record, 4), pyoma_poles(even_scores(record, 4), 30.0, max_modes=8), max_modes=8
    )
    np.testing.assert_allclose(ours.frequencies, theirs.frequencies, rtol=1e-3)
    np.testing.assert_allclose(ours.damping_ratios, theirs.damping_ratios, atol=2e-3)


def test_wind_without_pyoma_is_read_by_our_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ambient, "is_installed", lambda: False)
    displacement, _ = ambient_record(60.0, 0.02, 2)
    result = identify(displacement, IdentificationSpec(excitation="ambient"), seed=0)
    np.testing.assert_allclose(result.model.frequencies, FREQUENCIES, rtol=0.02)
    assert len(result.opinions) == 3


def test_a_noiseless_decay_has_stable_poles_at_its_own() -> None:
    omega = 2 * np.pi * 3.3
    times = np.arange(300) / 30.0
    series = np.exp(-0.02 * omega * times)[:, None] * np.column_stack(
        [np.cos(omega * np.sqrt(1 - 0.02**2) * times), 0.5 * np.cos(omega * np.sqrt(1 - 0.02**2) * times)]
    )
    noisy = series + 1e-6 * np.random.default_rng(0).normal(size=series.shape)
    stable = [pole for pole in stabilise(noisy, 30.0, max_modes=2) if pole.order == 2]
    assert stable[0].frequency == pytest.approx(3.3, rel=0.01)


def test_the_deviations_of_ambient_records_fall_with_the_root_of_time() -> None:
    minute, hour = ambient_deviations(2.0, 0.02, 60.0), ambient_deviations(2.0, 0.02, 3600.0)
    np.testing.assert_allclose(np.array(minute) / np.array(hour), np.sqrt(60.0))
    assert 1e3 * minute[0] == pytest.approx(10.3, rel=0.05)


def test_the_resonance_in_a_spectrum_of_known_shape() -> None:
    """An impulse response's periodogram is the squared transfer function itself, without any scatter."""
    omega, damping = 2 * np.pi * 3.3, 0.03
    times = np.arange(3000) / 30.0
    impulse = np.exp(-damping * omega * times) * np.sin(omega * np.sqrt(1 - damping**2) * times)
    (frequency, ratio), _ = refine_resonance(impulse, 30.0, (3.2, 0.05), [3.2])
    assert frequency == pytest.approx(3.3, rel=0.002)
    assert ratio == pytest.approx(damping, rel=0.05)


def test_a_short_record_keeps_the_start() -> None:
    assert refine_resonance(np.random.default_rng(0).normal(size=40), 30.0, (3.2, 0.05), [3.2])[0] == (3.2, 0.05)


def coordinate(damping: float) -> np.ndarray:
    omega = 2 * np.pi * 3.0
    return (np.exp(-damping * omega * TIMES) * np.cos(omega * TIMES))[:, None]


@pytest.mark.parametrize(("damping", "kind"), [(0.01, "free_decay"), (0.0, "harmonic")])
def test_sums_of_sinusoids_are_told_by_their_fall(damping: float, kind: str) -> None:
    assert recognise(TIMES, coordinate(damping), np.array([3.0]), np.array([damping])) == kind


def test_what_no_sinusoid_explains_is_ambient_if_it_vibrates() -> None:
    displacement, _ = ambient_record(30.0, 0.02, 3)
    wind = displacement.values[:, -1]
    assert recognise(displacement.times, wind, np.array([2.17]), np.array([0.02])) == "ambient"


def test_a_decay_drowned_in_noise_is_still_a_decay() -> None:
    drowned = coordinate(0.01) + 1.5 * np.random.default_rng(0).normal(size=(90, 1))
    assert recognise(TIMES, drowned, np.array([3.0]), np.array([0.01])) == "free_decay"


def test_a_given_excitation_is_said_and_nothing_is_called_a_free_decay() -> None:
    still = identify(displacement_of(np.zeros((90, 5))), IdentificationSpec(), seed=0)
    assert excitation_of([still], "harmonic") == "harmonic"
    assert excitation_of([still], "auto") == "free_decay"
