"""Modal coordinates obey the oscillator's equation under every force, and the wind has the spectrum it claims."""

import numpy as np
import pytest
from nerfmodal.simulate.excitation import coordinate_of, modal_coordinate, response, wind_spectrum
from nerfmodal.spec import AirPulse, FreeDecay, Harmonic, ImposedMode, SimulationSource, Wind
from scipy.integrate import quad, solve_ivp
from scipy.signal import welch

MODE = ImposedMode(
    organ="leaf_*", shape="bending_1", frequency_hz=2.3, damping_ratio=0.03, amplitude_m=0.04, phase_deg=25
)
W, ZETA, AMPLITUDE = 2 * np.pi * 2.3, 0.03, 0.04
GALE = Wind(kind="wind", low_hz=0.1, high_hz=12.0)


def integrated(force, times: np.ndarray) -> np.ndarray:
    """The oscillator from rest, stepped by a general solver: the slow reference."""

    def law(t: float, state: np.ndarray) -> list[float]:
        return [state[1], force(t) - 2 * ZETA * W * state[1] - W**2 * state[0]]

    return solve_ivp(law, (0, times[-1]), [0, 0], t_eval=times, max_step=2e-3, rtol=1e-8, atol=1e-10).y[0]


@pytest.mark.parametrize("duration", [0.02, 0.15, 1 / 4.6, 0.4])
def test_a_pulse_moves_the_mode_as_a_stepped_oscillator(duration):
    push, times = AirPulse(kind="pulse", at_s=0.2, duration_s=duration), np.linspace(0, 2, 300)
    size = AMPLITUDE * W * np.sqrt(1 - ZETA**2) * np.pi / (2 * duration)

    def force(t: float) -> float:
        return size * np.sin(np.pi * (t - 0.2) / duration) if 0.2 < t < 0.2 + duration else 0.0

    found = modal_coordinate(MODE, times, push)
    assert found == pytest.approx(integrated(force, times), abs=2e-5)
    assert not found[times <= 0.2].any()


def test_a_short_pulse_is_a_blow():
    push, times = AirPulse(kind="pulse", duration_s=1e-4), np.linspace(0.01, 2, 300)
    damped = W * np.sqrt(1 - ZETA**2)
    blow = AMPLITUDE * np.exp(-ZETA * W * times) * np.sin(damped * times)
    assert modal_coordinate(MODE, times, push) == pytest.approx(blow, abs=1e-3 * AMPLITUDE)


def test_a_pulse_is_defined_for_an_undamped_mode_at_its_own_frequency():
    undamped = MODE.model_copy(update={"damping_ratio": 0.0})
    motion = modal_coordinate(undamped, np.linspace(0, 3, 99), AirPulse(kind="pulse", duration_s=1 / 4.6))
    assert np.isfinite(motion).all()
    assert 0.5 * AMPLITUDE < np.abs(motion).max() < AMPLITUDE


def test_steady_motion_keeps_its_amplitude():
    times = np.arange(0, 10, 1e-3)
    motion = modal_coordinate(MODE, times, Harmonic(kind="harmonic"))
    assert np.abs(motion).max() == pytest.approx(AMPLITUDE, rel=1e-6)
    assert motion[0] == pytest.approx(AMPLITUDE * np.cos(np.radians(25)))


@pytest.mark.parametrize("frequency", [0.5, 2.3, 6.0])
def test_a_force_of_one_frequency_moves_the_mode_at_it_by_the_transfer_function(frequency):
    times = np.linspace(0, 60, 60001)
    found = modal_coordinate(MODE, times, Harmonic(kind="harmonic", frequency_hz=frequency))
    size = AMPLITUDE * 2 * ZETA * W**2  # a static force that gives this amplitude at resonance
    late = times > 50
    stepped = integrated(lambda t: size * np.cos(2 * np.pi * frequency * t), times[::20])
    assert np.std(found[late]) == pytest.approx(np.std(stepped[times[::20] > 50]), rel=2e-2)


def test_at_resonance_the_amplitude_is_that_of_the_specification():
    motion = modal_coordinate(MODE, np.arange(0, 10, 1e-3), Harmonic(kind="harmonic", frequency_hz=2.3))
    assert np.abs(motion).max() == pytest.approx(AMPLITUDE, rel=1e-6)


def test_the_response_peaks_at_half_the_inverse_damping():
    static, peak = response(MODE, np.array([0.0, 2.3]))
    assert abs(peak) / abs(static) == pytest.approx(1 / (2 * ZETA))


def test_a_white_wind_gives_the_specified_deviation():
    white = GALE.model_copy(update={"low_hz": 0.0, "high_hz": None})
    variance = quad(lambda f: float(wind_spectrum(MODE, white, np.array([f]))[0]), 0, 400, points=[2.3], limit=400)[0]
    assert np.sqrt(variance) == pytest.approx(AMPLITUDE, rel=1e-3)


def test_the_winds_response_has_the_closed_forms_spectrum():
    rate, seconds = 30.0, 400.0
    times = np.arange(0, seconds, 1 / rate)
    records = [
        modal_coordinate(MODE, times, GALE.model_copy(update={"seed": seed}), duration=seconds) for seed in range(6)
    ]
    frequencies, power = welch(np.stack(records), fs=rate, nperseg=1200)
    expected = wind_spectrum(MODE, GALE, frequencies)
    near = (frequencies > 1.0) & (frequencies < 6.0)
    ratio = power.mean(axis=0)[near] / expected[near]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.06)
    assert np.all((ratio > 0.5) & (ratio < 1.8))
    assert power.mean(axis=0)[frequencies > 12.5].max() < 1e-3 * power.max()


def test_the_wind_is_gaussian_and_its_variance_is_that_of_its_band():
    times = np.array([0.7, 1.9])
    draws = np.stack(
        [modal_coordinate(MODE, times, GALE.model_copy(update={"seed": seed}), duration=9.0) for seed in range(400)]
    )
    variance = quad(lambda f: float(wind_spectrum(MODE, GALE, np.array([f]))[0]), 0.1, 12, points=[2.3], limit=200)[0]
    assert draws.std() == pytest.approx(np.sqrt(variance), rel=0.08)
    assert np.mean(draws**4) / np.mean(draws**2) ** 2 == pytest.approx(3.0, abs=0.6)
    assert abs(draws.mean()) < 0.12 * AMPLITUDE


def test_a_wind_repeats_itself_for_a_seed_and_is_another_for_another_organ():
    source = SimulationSource(kind="simulation", frames=60, frame_rate_hz=30, motion=(MODE,), excitation=GALE)
    times = np.arange(60) / 30
    first = coordinate_of(source, "leaf_0", MODE, times)
    assert np.array_equal(first, coordinate_of(source, "leaf_0", MODE, times))
    assert np.corrcoef(first, coordinate_of(source, "leaf_1", MODE, times))[0, 1] < 0.9
    between = coordinate_of(source, "leaf_0", MODE, times[10:11])
    assert between[0] == pytest.approx(first[10])


def test_a_winds_band_ends_at_half_the_frame_rate():
    source = SimulationSource(
        kind="simulation", frames=900, frame_rate_hz=30, motion=(MODE,), excitation=Wind(kind="wind")
    )
    fine = np.arange(0, 30, 1 / 120)
    frequencies, power = welch(coordinate_of(source, "leaf_0", MODE, fine), fs=120, nperseg=600)
    assert power[frequencies > 15.5].max() < 1e-6 * power.max()


def test_without_a_force_a_mode_decays():
    times = np.linspace(0, 2, 50)
    assert np.array_equal(modal_coordinate(MODE, times), modal_coordinate(MODE, times, FreeDecay()))


def test_the_energy_of_a_decay_falls_as_its_damping_says():
    h, w_damped = 1e-5, W * np.sqrt(1 - ZETA**2)
    times = 0.3 + 2 * np.pi / w_damped * np.arange(6)
    speed = (modal_coordinate(MODE, times + h) - modal_coordinate(MODE, times - h)) / (2 * h)
    energy = 0.5 * speed**2 + 0.5 * W**2 * modal_coordinate(MODE, times) ** 2
    assert np.diff(np.log(energy)) == pytest.approx(-4 * np.pi * ZETA / np.sqrt(1 - ZETA**2), rel=1e-5)


def test_a_decay_swings_at_the_damped_frequency():
    times = np.arange(0, 4, 1e-4)
    motion = modal_coordinate(MODE, times)
    crossings = times[:-1][(motion[:-1] < 0) & (motion[1:] >= 0)]
    assert 1 / np.diff(crossings).mean() == pytest.approx(2.3 * np.sqrt(1 - ZETA**2), rel=1e-4)
