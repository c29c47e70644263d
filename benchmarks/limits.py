"""Against the physical limit: errors over the Cramér-Rao bound, coverage of intervals, drift, wind, missing patches."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from nerfmodal.bounds import cramer_rao
from nerfmodal.identify import identify
from nerfmodal.identify.lines import damped_columns
from nerfmodal.identify.sinusoids import fit_sinusoids
from nerfmodal.reproduction.scores import true_displacement
from nerfmodal.spec import IdentificationSpec, OrganSpec
from nerfmodal.surface import measure_organ
from nerfmodal.types import OrganResult, PointCloud, Reason, TrueMode

from benchmarks.rows import Row
from tests.fixtures.ambient import FREQUENCIES, ambient_record
from tests.fixtures.moving_clouds import Flaws, Mode, Scene, leaf_clouds

RATE = 30.0
TIMES = np.arange(90) / RATE
MODES = (
    Mode(shape="bending_1", frequency=2.17, damping=0.005, amplitude=0.03),
    Mode(shape="bending_2", frequency=4.83, damping=0.01, amplitude=0.02),
    Mode(shape="torsion_1", frequency=9.61, damping=0.02, amplitude=0.015),
)
INSIDE = 1.96


def bound_rows(seeds: int) -> Iterator[Row]:
    """Three lines in eight channels of correlated noise, each at 10 times its noise."""
    lines = np.array([[mode.frequency, mode.damping] for mode in MODES])
    shapes = np.random.default_rng(0).normal(size=(3, 8))
    root = np.eye(8) + 0.5 * np.random.default_rng(1).normal(size=(8, 8))
    weight = np.linalg.inv(root @ root.T)
    amplitudes = 10.0 / np.sqrt(np.einsum("mc,cd,md->m", shapes, weight, shapes))
    columns = damped_columns(TIMES, lines)[:, 1:]
    errors = []
    for seed in range(10 * seeds):
        rng = np.random.default_rng(seed)
        phases = rng.uniform(0, 2 * np.pi, 3)
        q = (columns[:, ::2] * np.cos(phases) - columns[:, 1::2] * np.sin(phases)) * amplitudes
        channels = q @ shapes + rng.normal(size=(90, 8)) @ root.T
        fit = fit_sinusoids(TIMES, channels, frame_rate=RATE, max_modes=8, rng=rng)
        places = [int(np.argmin(np.abs(fit.frequencies - frequency))) for frequency in lines[:, 0]]
        errors.append(np.column_stack([fit.frequencies, fit.damping_ratios])[places] - lines)
    bounds = np.array([cramer_rao(TIMES, frequency, damping, 10.0) for frequency, damping in lines])
    ratios = np.sqrt(np.mean(np.square(errors), axis=0)) / bounds
    yield Row(what="frequency error over the bound, worst mode", value=ratios[:, 0].max(), unit="x", floor=1.5, aim=1.1)
    yield Row(what="damping error over the bound, worst mode", value=ratios[:, 1].max(), unit="x", floor=1.5, aim=1.1)


def coverage_rows(seeds: int) -> Iterator[Row]:
    """Share of 95 % intervals that hold the truth, over frequencies and damping ratios of three modes."""
    for bias in (0.001, 0.003):
        scores = [_scores(identify_leaf(*_leaf(seed, bias=bias))[0]) for seed in range(5 * seeds)]
        inside = np.abs(np.concatenate(scores)) < INSIDE
        for column, name in enumerate(("frequency", "damping")):
            what = f"coverage of the 95 % interval of {name}, bias {1e3 * bias:.0f} mm"
            yield Row(what=what, value=inside[:, column].mean(), unit="-", floor=0.88, aim=0.93)


def drift_rows(seeds: int) -> Iterator[Row]:
    """Bias with a memory of 0.7 from frame to frame: all intervals hold the truth, or the result says DRIFT."""
    honest = []
    for seed in range(2 * seeds):
        organ, _ = identify_leaf(*_leaf(seed, bias=0.003, memory=0.7))
        flagged = any(Reason.DRIFT in quality.reasons for quality in organ.model.quality)
        honest.append(flagged or bool(np.all(np.abs(_scores(organ)) < INSIDE)))
    yield Row(what="drifting bias: truth inside or DRIFT said", value=np.mean(honest), unit="-", floor=0.9, aim=0.98)


def ambient_rows(seeds: int) -> Iterator[Row]:
    """A minute of wind at 2 % damping."""
    errors, found = [], 0
    for seed in range(seeds):
        displacement, _ = ambient_record(60.0, 0.02, seed)
        frequencies = identify(displacement, IdentificationSpec(), seed=0).model.frequencies
        near = [np.abs(frequencies - true).min(initial=np.inf) / true for true in FREQUENCIES]
        found += max(near) < 0.05
        errors.append(near)
    worst = np.sqrt(np.mean(np.square(errors), axis=0)).max()
    yield Row(what="ambient 60 s: records with all modes found", value=found / seeds, unit="-", floor=1.0, aim=1.0)
    yield Row(what="ambient 60 s: frequency error, worst mode", value=100 * worst, unit="%", floor=1.0, aim=0.4)


def patch_rows(seeds: int) -> Iterator[Row]:
    """A fifth of the leaf missing in 30 % of the frames against none missing."""
    ratios = []
    for seed in range(max(2, seeds // 2)):
        whole, holed = (_displacement_error(*_leaf(seed, bias=0.0, patch=patch)) for patch in (0.0, 0.3))
        ratios.append(holed / whole)
    yield Row(what="displacement error with patches missing", value=np.median(ratios), unit="x", floor=1.5, aim=1.1)


def identify_leaf(clouds: Sequence[PointCloud], truth: list[TrueMode]) -> tuple[OrganResult, list[TrueMode]]:
    """The leaf's result and the truth."""
    track = measure_organ(
        OrganSpec(name="leaf", sensors=300),
        clouds,
        reference="mean",
        times=TIMES,
        frame_rate=RATE,
        rng=np.random.default_rng(0),
        report=lambda _done, _total, _message: None,
    )
    return identify(track.displacement, IdentificationSpec(), seed=0), truth


def _leaf(
    seed: int, *, bias: float, memory: float = 0.0, patch: float = 0.0
) -> tuple[list[PointCloud], list[TrueMode]]:
    rng = np.random.default_rng(1000 + seed)
    modes = tuple(replace(mode, phase=rng.uniform(0, 2 * np.pi)) for mode in MODES)
    flaws = Flaws(noise=0.004, bias=bias, bias_memory=memory, missing_patch=patch)
    return leaf_clouds(Scene(modes=modes, points=2000, flaws=flaws), seed)


def _scores(organ: OrganResult) -> np.ndarray:
    """Errors of frequency and damping in stated deviations, of the strongest line near each true mode."""
    model, rows = organ.model, []
    for mode in MODES:
        near = np.flatnonzero(np.abs(model.frequencies - mode.frequency) < 0.4)
        if len(near):
            best = max(near, key=lambda index: model.quality[index].energy_share)
            rows.append(
                (
                    (model.frequencies[best] - mode.frequency) / model.frequency_stds[best],
                    (model.damping_ratios[best] - mode.damping) / model.damping_stds[best],
                )
            )
    return np.array(rows).reshape(-1, 2)


def _displacement_error(clouds: Sequence[PointCloud], truth: list[TrueMode]) -> float:
    organ, _ = identify_leaf(clouds, truth)
    moved = true_displacement(organ, truth)
    moved = moved - np.mean(moved, axis=0)
    return float(np.sqrt(np.mean((organ.displacement.values[:, :, 0] - moved) ** 2)))
