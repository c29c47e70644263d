"""Does preflight tell the truth? `python -m benchmarks.preflight [--seeds 20]`: predicted against real spread.

Three scans whose clouds are drawn with a smooth bias of known size in every frame (what matters of a reconstruction),
each from as many seeds; the root mean square of the errors over what preflight says from the specification. Prints a
table and writes out/benchmarks/preflight.json. Rendered scans take hours of twenty seeds: `nerfmodal certify` films
and reconstructs eighteen lines at once, and its noise is the fourth check (docs/howto/certificate.md).
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from nerfmodal.identify import identify
from nerfmodal.preflight import ExpectedMode, Seen, preflight
from nerfmodal.spec import IdentificationSpec, OrganSpec, ScanSpec
from nerfmodal.surface import measure_organ

from benchmarks.rows import Row, print_and_write
from tests.fixtures.moving_clouds import HALF_WIDTH, LENGTH, SHAPES, Flaws, Mode, Scene, leaf_clouds

OUT = Path("out/benchmarks/preflight.json")
DEGREE, PLACES, POINTS = 5, 600, 2000
"""Of the surface that follows the leaf; places at which its errors are compared with a shape; points of a cloud."""
NEAR_HZ = 0.5


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A leaf's modes, its record, and the bias of its clouds in metres."""

    name: str
    modes: tuple[Mode, ...]
    frames: int
    frame_rate: float
    bias: float


TRIALS = (
    Trial(
        name="3 s at 30 Hz, damping 1 %, bias 1 mm",
        modes=(
            Mode(shape="bending_1", frequency=2.17, amplitude=0.03),
            Mode(shape="bending_2", frequency=4.83, amplitude=0.02),
            Mode(shape="torsion_1", frequency=9.61, amplitude=0.015),
        ),
        frames=90,
        frame_rate=30.0,
        bias=0.001,
    ),
    Trial(
        name="3.2 s at 15 Hz, damping 4 %, bias 0.5 mm",
        modes=(
            Mode(shape="bending_1", frequency=1.37, damping=0.04, amplitude=0.03),
            Mode(shape="torsion_1", frequency=4.6, damping=0.04, amplitude=0.02),
        ),
        frames=48,
        frame_rate=15.0,
        bias=0.0005,
    ),
    Trial(
        name="1 s at 120 Hz, undamped, bias 2 mm",
        modes=(
            Mode(shape="bending_1", frequency=7.3, damping=0.0, amplitude=0.03),
            Mode(shape="bending_2", frequency=31.0, damping=0.0, amplitude=0.02),
        ),
        frames=120,
        frame_rate=120.0,
        bias=0.002,
    ),
)


def main() -> None:
    """Run all trials, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    print_and_write((row for trial in TRIALS for row in trial_rows(trial, seeds)), OUT)


def trial_rows(trial: Trial, seeds: int) -> Iterator[Row]:
    """Real over predicted spread of every mode, frequency and damping: at the worst a factor of two either way."""
    told = forecasts(trial)
    errors = np.array([errors_of(trial, seed) for seed in range(seeds)])
    for index, mode in enumerate(trial.modes):
        seen = errors[np.isfinite(errors[:, index, 0]), index]
        spread = np.sqrt(np.mean(seen**2, axis=0))
        for part, name in enumerate(("frequency", "damping")):
            ratio = float(spread[part] / told[index][part])
            what = f"{trial.name}: {mode.frequency:g} Hz {name}, real {spread[part]:.2g} over predicted"
            yield Row(what=f"{what} {told[index][part]:.2g}", value=max(ratio, 1 / ratio), unit="x", floor=2, aim=1.3)
        yield Row(
            what=f"{trial.name}: {mode.frequency:g} Hz found", value=len(seen) / seeds, unit="-", floor=0.95, aim=1.0
        )


def forecasts(trial: Trial) -> list[tuple[float, float]]:
    """What preflight says of each mode: standard deviations of frequency and damping."""
    spec = ScanSpec.model_validate({"source": {"kind": "clouds", "path": "."}})
    told = []
    for mode in trial.modes:
        [line] = preflight(
            spec,
            seen=Seen(frames=trial.frames, frame_rate=trial.frame_rate),
            expected=[ExpectedMode(frequency=mode.frequency, damping_ratio=mode.damping, amplitude=mode.amplitude)],
            noise=noise_of(mode.shape, trial.bias),
        ).modes
        told.append((line.frequency_std_hz or np.nan, line.damping_std or np.nan))
    return told


def noise_of(shape: str, bias: float) -> float:
    """Noise of a modal coordinate (m) in clouds of this bias and the generator's own noise of a point.

    That of a weighted fit: 1 / sqrt(bᵀ S⁻¹ b) with the shape b and the covariance S of a frame's errors in
    coefficients of the surface. Of a bias alone: 0.79 of it for the first bending, 0.59 for the second, 0.38 for the
    torsion.
    """
    rng = np.random.default_rng(0)
    s, y = rng.uniform(0, 1, PLACES), rng.uniform(-1, 1, PLACES)
    inside = (2 * s - 1) ** 4 + y**2 < 1
    s, y = s[inside], y[inside]
    x, z = s * LENGTH, y * HALF_WIDTH
    distance = np.hypot(np.subtract.outer(x, x), np.subtract.outer(z, z))
    smooth = np.exp(-0.5 * (distance / Flaws().bias_length) ** 2)
    terms = np.stack([(2 * s - 1) ** i * y**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=1)
    fit = np.linalg.pinv(terms)
    points = np.linalg.inv(terms.T @ terms) * len(s) / POINTS
    covariance = bias**2 * fit @ smooth @ fit.T + Flaws().noise ** 2 * points
    size = SHAPES[shape](s, y)
    coefficients = fit @ (size / np.abs(size).max())
    return float(1 / np.sqrt(coefficients @ np.linalg.solve(covariance, coefficients)))


def errors_of(trial: Trial, seed: int) -> np.ndarray:
    """Errors of frequency and damping of every mode, from clouds to modes; NaN of one that was not found."""
    rng = np.random.default_rng(5000 + seed)
    modes = tuple(replace(mode, phase=rng.uniform(0, 2 * np.pi)) for mode in trial.modes)
    times = np.arange(trial.frames) / trial.frame_rate
    clouds, _ = leaf_clouds(Scene(modes=modes, times=times, points=POINTS, flaws=Flaws(bias=trial.bias)), seed)
    track = measure_organ(
        OrganSpec(name="leaf", sensors=300),
        clouds,
        reference="mean",
        times=times,
        frame_rate=trial.frame_rate,
        rng=np.random.default_rng(0),
        report=lambda _done, _total, _message: None,
    )
    model = identify(track.displacement, IdentificationSpec(), seed=0).model
    errors = np.full((len(modes), 2), np.nan)
    for index, mode in enumerate(modes):
        near = np.flatnonzero(np.abs(model.frequencies - mode.frequency) < NEAR_HZ)
        if len(near):
            best = max(near, key=lambda place: model.quality[place].energy_share)
            found = model.frequencies[best], model.damping_ratios[best]
            errors[index] = np.subtract(found, (mode.frequency, mode.damping))
    return errors


if __name__ == "__main__":
    main()
