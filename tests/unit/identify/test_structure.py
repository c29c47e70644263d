"""Motions that organs share, from known mixtures: what moves as one is joined, equal frequencies alone are not."""

import numpy as np
import pytest
from nerfmodal.identify.structure import phasors, structure_modes
from nerfmodal.types import (
    DisplacementMatrix,
    ModalModel,
    ModeQuality,
    OrganResult,
    SensorGrid,
    Verdict,
)

TIMES = np.arange(120) / 30.0
SENSORS = 7


def organ(
    name: str, lines: list[tuple[float, np.ndarray]], times: np.ndarray = TIMES, deviation: float = 0.01
) -> OrganResult:
    """An organ with these modes (frequency, coordinate); every shape is a ramp along its normal."""
    count = len(lines)
    shapes = np.repeat(np.linspace(0.1, 1, SENSORS)[:, None, None], count, axis=2)
    positions = np.column_stack([np.linspace(0, 1, SENSORS), np.zeros(SENSORS), np.zeros(SENSORS)])
    coordinates = np.stack([coordinate for _, coordinate in lines], axis=1)
    quality = ModeQuality(energy_share=0.5, mpc=1.0, mac_between_methods=None, verdict=Verdict.ACCEPTED)
    return OrganResult(
        organ=name,
        surface="polynomial",
        displacement=DisplacementMatrix.of_values(
            np.einsum("tm,sam->tsa", coordinates, shapes),
            directions=np.array([[0.0, 0.0, 1.0]]),
            times=times,
            frame_rate=30.0,
            sensors=SensorGrid(organ=name, positions=positions),
            valid=np.ones(len(times), dtype=bool),
        ),
        reduction=None,
        model=ModalModel(
            frequencies=np.array([frequency for frequency, _ in lines]),
            frequency_stds=np.full(count, deviation),
            damping_ratios=np.full(count, 0.01),
            damping_stds=np.full(count, 0.001),
            mode_shapes=shapes,
            coordinates=coordinates,
            quality=(quality,) * count,
        ),
    )


def decay(
    frequency: float, amplitude: float = 1.0, phase: float = 0.0, times: np.ndarray = TIMES, seed: int = 0
) -> np.ndarray:
    noise = 0.02 * amplitude * np.random.default_rng(seed).normal(size=len(times))
    ring = np.exp(-0.01 * 2 * np.pi * frequency * times) * np.cos(2 * np.pi * frequency * times + phase)
    return amplitude * ring + noise


def test_the_phasors_of_a_line_are_its_amplitude_and_phase_in_every_segment() -> None:
    uneven = np.sort(np.random.default_rng(1).uniform(0, 4, 150))
    coordinate = 0.7 * np.cos(2 * np.pi * 2.0 * uneven + 0.4)
    coordinate[[3, 70]] = np.nan
    np.testing.assert_allclose(phasors(coordinate, uneven, 2.0), 0.7 * np.exp(0.4j), atol=1e-9)


def test_organs_that_move_as_one_are_joined_with_their_signed_amplitudes() -> None:
    organs = [
        organ("trunk", [(1.0, decay(1.0, 0.02))]),
        organ("leaf_0", [(1.004, decay(1.0, 0.05, 0.05, seed=1)), (2.0, decay(2.0, 0.03, seed=2))]),
        organ("leaf_1", [(0.997, decay(1.0, -0.025, 0.05, seed=3)), (2.9, decay(2.9, 0.03, seed=4))]),
    ]
    (found,) = structure_modes(organs, TIMES)
    assert dict(zip(found.organs, found.modes, strict=True)) == {"leaf_0": 0, "leaf_1": 0, "trunk": 0}
    amplitudes = dict(zip(found.organs, found.amplitudes, strict=True))
    assert amplitudes["leaf_0"] == 1.0
    assert amplitudes["leaf_1"] == pytest.approx(-0.5, abs=0.02)
    assert amplitudes["trunk"] == pytest.approx(0.4, abs=0.02)
    assert found.frequency == pytest.approx(1.0, abs=0.005)
    assert found.frequency_std == pytest.approx(0.01 / np.sqrt(3))
    assert found.coherences.min() > 0.99


def test_the_global_shape_is_each_organ_s_own_times_its_amplitude() -> None:
    organs = [organ("a", [(1.0, decay(1.0, 0.04))]), organ("b", [(1.0, decay(1.0, -0.02, seed=1))])]
    (found,) = structure_modes(organs, TIMES)
    ramp = np.linspace(0.1, 1, SENSORS)
    expected = np.concatenate([ramp, found.amplitudes[1] * ramp])
    np.testing.assert_allclose(found.shape, np.outer(expected, [0.0, 0.0, 1.0]), atol=1e-12)
    assert found.positions.shape == (2 * SENSORS, 3)
    np.testing.assert_allclose(found.coordinates, decay(1.0, 0.04), atol=0.004)


@pytest.mark.parametrize("phase", [0.6, np.pi / 2, 2.4])
def test_the_same_frequency_at_another_phase_is_no_common_motion(phase: float) -> None:
    organs = [organ("a", [(2.0, decay(2.0))]), organ("b", [(2.0, decay(2.0, 1.0, phase, seed=1))])]
    assert structure_modes(organs, TIMES) == ()


def test_a_phase_that_drifts_is_no_common_motion_even_within_the_deviations() -> None:
    times = np.arange(1200) / 30.0
    ambient = [
        organ("a", [(2.0, np.cos(2 * np.pi * 2.0 * times))], times, deviation=0.05),
        organ("b", [(2.02, np.cos(2 * np.pi * 2.02 * times - 2.5))], times, deviation=0.05),
    ]
    assert structure_modes(ambient, times) == ()
    steady = [ambient[0], organ("b", [(2.02, np.cos(2 * np.pi * 2.0 * times))], times, deviation=0.05)]
    assert len(structure_modes(steady, times)) == 1


def test_frequencies_beyond_their_deviations_are_not_joined_whatever_the_phase() -> None:
    organs = [organ("a", [(2.0, decay(2.0))], deviation=0.001), organ("b", [(2.05, decay(2.0))], deviation=0.001)]
    assert structure_modes(organs, TIMES) == ()


def test_an_organ_gives_one_mode_at_most() -> None:
    close = [(2.0, decay(2.0, 0.05)), (2.01, decay(2.0, 0.03, seed=1))]
    (found,) = structure_modes([organ("a", close), organ("b", [(2.0, decay(2.0, 0.02, seed=2))])], TIMES)
    assert sorted(found.organs) == ["a", "b"]
    assert found.modes[found.organs.index("a")] == 0


def test_nothing_is_shared_by_one_organ() -> None:
    assert structure_modes([organ("a", [(2.0, decay(2.0))])], TIMES) == ()
