"""Preflight: every finding with the scan that calls for it, and forecasts that hold on records whose truth is known."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from nerfmodal.bounds import cramer_rao
from nerfmodal.identify.sinusoids import fit_sinusoids
from nerfmodal.preflight import ExpectedMode, Pace, PastStep, Seen, pace_of, preflight
from nerfmodal.preflight.expected import footprint_of, limits_of
from nerfmodal.preflight.forecast import MOST_INSTANTS, OVER_THE_BOUND, forecast, instants
from nerfmodal.spec import ReconstructionSpec, RigSpec, ScanSpec

MODE = {"organ": "leaf_0", "shape": "bending_1", "frequency_hz": 2.17, "amplitude_m": 0.05}
CLOUDS = ScanSpec.model_validate({"source": {"kind": "clouds", "path": "."}})


def scan(*modes: dict[str, Any], frames: int = 90, **changes: Any) -> ScanSpec:
    """A simulation of these modes; changes are of its source."""
    motion = [MODE | mode for mode in modes] or [MODE]
    source = {"kind": "simulation", "frames": frames, "frame_rate_hz": 30, "motion": motion}
    return ScanSpec.model_validate({"source": source | changes})


def codes(spec: ScanSpec, **known: Any) -> set[str]:
    return {finding.code for finding in preflight(spec, **known).findings}


def test_a_good_scan_has_only_notes():
    answer = preflight(scan())
    assert answer.verdict == "ok"
    assert {finding.severity for finding in answer.findings} == {"note"}
    assert answer.record is not None
    assert answer.record.bin_width_hz == pytest.approx(1 / 3)
    assert answer.record.nyquist_hz == 15.0


def test_a_pixel_covers_what_the_lens_spreads_over_it():
    rig = RigSpec(radius_m=3.0, width_px=200, height_px=100, field_of_view_deg=90)
    assert footprint_of(rig) == pytest.approx(2 * 3.0 / 200)


@pytest.mark.parametrize(
    ("spec", "code", "verdict"),
    [
        (scan(frames=15), "TOO_FEW_FRAMES", "refuse"),
        (scan({"frequency_hz": 0.5}), "RECORD_TOO_SHORT", "warn"),
        (scan({"amplitude_m": 0.0001}), "BELOW_NOISE", "warn"),
        (scan({}, {"frequency_hz": 2.3}), "CLOSE_MODES", "warn"),
        (scan({}, {"frequency_hz": 7.0, "amplitude_m": 0.0009}), "WEAK", "warn"),
        (scan({}, {"frequency_hz": 4.34, "amplitude_m": 0.009}), "HARMONIC", "warn"),
        (scan(excitation={"kind": "wind"}), "AMBIENT_TOO_SHORT", "refuse"),
        (scan(excitation={"kind": "wind"}, frames=900), "AMBIENT_DAMPING_POOR", "warn"),
        (scan(excitation={"kind": "harmonic"}), "DAMPING_NOT_SEEN", "warn"),
        (scan(motion=[]), "NOTHING_MOVES", "warn"),
    ],
)
def test_what_is_wrong_is_said_with_its_key_and_the_remedy(spec: ScanSpec, code: str, verdict: str):
    answer = preflight(spec)
    assert answer.verdict == verdict
    [finding] = [one for one in answer.findings if one.code == code]
    assert finding.pointer.startswith("/source")
    assert finding.hint.endswith(".")


def test_the_gravest_finding_comes_first():
    severities = [one.severity for one in preflight(scan({"frequency_hz": 0.5}, frames=15)).findings]
    assert severities == sorted(severities, key=["refuse", "warn", "note"].index)


def test_a_record_nobody_has_opened_is_unknown_and_one_that_was_is_told():
    assert preflight(CLOUDS).record is None
    assert codes(CLOUDS) == {"RECORD_UNKNOWN"}
    seen = Seen(frames=90, frame_rate=30.0)
    answer = preflight(CLOUDS, seen=seen)
    assert {"MODES_UNKNOWN", "NOISE_UNKNOWN"} <= {one.code for one in answer.findings}
    assert [line.amplitude_to_noise for line in answer.resolves] == [10.0] * 5
    assert answer.cost is not None
    assert [step.step for step in answer.cost.steps] == ["scan.identify"]


def test_expected_modes_are_read_from_a_word():
    mode = ExpectedMode.parse("20:0.01:12")
    assert (mode.frequency, mode.damping_ratio, mode.amplitude) == (20.0, 0.01, 0.012)
    assert "ALIAS" in codes(CLOUDS, seen=Seen(frames=90, frame_rate=30.0), expected=[mode])
    for wrong in ("2", "2:x:1", "2:1.5:3", "-2:0.1:3", "2:0.1:inf"):
        with pytest.raises(ValueError, match=r"Write|positive"):
            ExpectedMode.parse(wrong)


def test_the_time_is_that_of_past_steps_by_units_of_work():
    pace = pace_of([PastStep(step="frame.train", variant="grid", seconds=s, units=1e6) for s in (1.0, 2.0, 30.0)], 3)
    assert pace.seconds_per_unit == {"frame.train grid": 2e-6}
    spec = scan()
    cost = preflight(spec, pace=pace).cost
    assert cost is not None
    [train] = [step for step in cost.steps if step.step == "frame.train"]
    work = spec.reconstruction.fine_tune_iterations * spec.reconstruction.rays_per_batch
    assert (train.basis, train.seconds_each) == ("history", pytest.approx(2e-6 * work, abs=1e-3))
    one, three = (preflight(spec, pace=Pace(slots=slots)).cost for slots in (1, 3))
    assert one is not None
    assert three is not None
    assert one.work_s == three.work_s
    beside = sum(step.count * step.seconds_each for step in one.steps[:-1])
    assert one.elapsed_s - three.elapsed_s == pytest.approx(beside * 2 / 3, abs=0.2)


def test_a_deadline_that_cannot_be_met_is_refused():
    spec = scan().model_copy(update={"deadline_s": 1.0})
    assert preflight(spec).verdict == "refuse"
    assert "DEADLINE" in codes(spec)


def test_no_number_is_nan():
    def leaves(value: Any) -> list[float]:
        if isinstance(value, dict):
            return [leaf for item in value.values() for leaf in leaves(item)]
        if isinstance(value, list | tuple):
            return [leaf for item in value for leaf in leaves(item)]
        return [value] if isinstance(value, float) else []

    extremes = [
        scan(frames=1),
        scan({"damping_ratio": 0.999}),
        scan(frames=100_000),
        *(scan({"frequency_hz": low}) for low in (1e-300, 1e-3, 0.05)),
        scan({"amplitude_m": 1e300}),
        scan(rig={"radius_m": 1e308}),
        scan(rig={"radius_m": 1e-300}),
        scan().model_copy(update={"reconstruction": ReconstructionSpec(fine_tune_iterations=10**400)}),
        scan().model_copy(update={"reconstruction": ReconstructionSpec(voxel_m=1e308)}),
    ]
    for spec in extremes:
        assert np.isfinite(leaves(asdict(preflight(spec)))).all()
    huge = ExpectedMode.parse("999999999:0.5:999999999")
    answer = preflight(CLOUDS, seen=Seen(frames=90, frame_rate=30.0), expected=[huge], noise=1e-300)
    assert np.isfinite(leaves(asdict(answer))).all()


def test_a_long_record_is_thinned_without_changing_the_forecast():
    frames = 2 * MOST_INSTANTS
    record = limits_of(Seen(frames=frames, frame_rate=30.0))
    told = forecast(ExpectedMode(frequency=5.0, damping_ratio=0.0, amplitude=1.0), record, "free_decay", 0.1)
    exact, _ = cramer_rao(np.arange(frames) / 30.0, 5.0, 0.0, 10.0)
    assert told.frequency_std_hz == pytest.approx(OVER_THE_BOUND * exact, rel=0.03)
    times, worth = instants(record)
    assert (len(times), worth) == (MOST_INSTANTS, pytest.approx(np.sqrt(2)))


def test_the_forecast_holds_for_the_estimator():
    """Forty records of one damped line in eight channels of noise: their spread is within a factor of two."""
    record = limits_of(Seen(frames=90, frame_rate=30.0))
    told = forecast(ExpectedMode(frequency=4.83, damping_ratio=0.02, amplitude=0.012), record, "free_decay", 0.001)
    times = np.arange(90) / 30.0
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        angle = 2 * np.pi * 4.83 * np.sqrt(1 - 0.02**2) * times + rng.uniform(0, 2 * np.pi)
        line = 0.012 * np.exp(-0.02 * 2 * np.pi * 4.83 * times) * np.cos(angle)
        shape = rng.normal(size=8)
        channels = np.outer(line, shape / np.linalg.norm(shape)) + 0.001 * rng.normal(size=(90, 8))
        fit = fit_sinusoids(times, channels, frame_rate=30.0, max_modes=2, rng=rng)
        best = int(np.argmin(np.abs(fit.frequencies - 4.83)))
        errors.append((fit.frequencies[best] - 4.83, fit.damping_ratios[best] - 0.02))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert told.frequency_std_hz is not None
    assert told.damping_std is not None
    assert 0.5 < spread[0] / told.frequency_std_hz < 2
    assert 0.5 < spread[1] / told.damping_std < 2
