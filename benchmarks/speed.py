"""Time of the processor: each number is a ratio within one run, so that neither the machine nor its load matters."""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from nerfmodal.identify import identify
from nerfmodal.identify.readings import Record
from nerfmodal.identify.reduction import principal_axes, reduce_coefficients
from nerfmodal.identify.subspace import read_subspace
from nerfmodal.spec import IdentificationSpec
from nerfmodal.surface.basis import PolynomialBasis
from nerfmodal.surface.robust import fit_robustly

from benchmarks.rows import Row
from tests.fixtures.ambient import ambient_record, displacement_of, factored

BASIS = PolynomialBasis(degree=5, center=np.zeros(2), half=np.ones(2))


def speed_rows(_seeds: int) -> Iterator[Row]:
    """Robust fit, growth with the record's length, many sensors against pyOMA_2."""
    yield _robust_fit()
    short, long = (_seconds(lambda duration=duration: _identify_wind(duration), 1) for duration in (34.0, 334.0))
    yield Row(what="time from 1,000 to 10,000 frames", value=long / short, unit="x", floor=12, aim=10)
    yield from _against_pyoma()


def _robust_fit() -> Row:
    rng = np.random.default_rng(0)
    design = BASIS.evaluate(rng.uniform(-1, 1, size=(100_000, 2)))
    heights = design @ (0.05 * rng.normal(size=21)) + 0.005 * rng.normal(size=100_000)
    heights[:5000] += rng.uniform(0.05, 0.3, 5000)
    once = _seconds(lambda: design.T @ design, 9)
    ratio = _seconds(lambda: fit_robustly(design, heights), 9) / once
    return Row(what="robust fit of 100,000 points over one normal matrix", value=ratio, unit="x", floor=8, aim=5)


def _identify_wind(duration: float) -> None:
    displacement, _ = ambient_record(duration, 0.02, 0)
    identify(displacement, IdentificationSpec(), seed=0)


def _against_pyoma() -> Iterator[Row]:
    try:
        from pyoma2.algorithms import SSI
        from pyoma2.setup import SingleSetup
    except ImportError:
        print("the comparison with pyOMA_2 is left out: pip install pyOMA_2", file=sys.stderr)
        return
    rng = np.random.default_rng(0)
    times = np.arange(90) / 30.0
    shapes = 0.1 * rng.normal(size=(3, 21))
    q = np.stack([np.exp(-0.06 * f * times) * np.cos(2 * np.pi * f * times) for f in (2.17, 4.83, 9.61)], axis=1)
    coefficients = 0.03 * q @ shapes + 1e-4 * rng.normal(size=(90, 21))
    coefficients -= coefficients.mean(axis=0)
    basis = BASIS.evaluate(rng.uniform(-1, 1, size=(99_990, 2)))
    displacement = factored(coefficients, basis)
    ours = _seconds(lambda: identify(displacement, IdentificationSpec(), seed=0), 9)
    scores = reduce_coefficients(coefficients, basis).scores

    def theirs() -> None:
        setup = SingleSetup(scores, fs=30.0)
        algorithm = SSI(name="ssi", method="cov", br=15, ordmax=30)
        setup.add_algorithms(algorithm)
        setup.run_by_name("ssi")

    ratio = ours / _seconds(theirs, 9)
    yield Row(what="99,990 sensors x 90 frames over pyOMA_2's SSI-cov", value=ratio, unit="x", floor=1.0, aim=0.3)


def example_rows(_seeds: int) -> Iterator[Row]:
    """The record of pyOMA_2's own example in the place of the scores, against its SSI-cov with its own deviations."""
    try:
        from pyoma2.algorithms import SSI
        from pyoma2.functions.gen import example_data
        from pyoma2.setup import SingleSetup
    except ImportError:
        print("pyOMA_2's example is left out: pip install pyOMA_2", file=sys.stderr)
        return
    record, _, (true, _, _) = example_data()
    setup = SingleSetup(record, fs=100.0)
    algorithm = SSI(name="ssi", method="cov", br=30, ordmax=30, calc_unc=True)
    setup.add_algorithms(algorithm)
    setup.run_by_name("ssi")
    algorithm.mpe(sel_freq=list(true), order_in=10)
    theirs = algorithm.result
    displacement = replace(displacement_of(record), times=np.arange(len(record)) / 100.0, frame_rate=100.0)
    axes = principal_axes(displacement.coefficients, displacement.basis)
    ours = read_subspace(Record(displacement=displacement, axes=axes), 5, max_modes=8)
    places = [int(np.argmin(np.abs(ours.frequencies - frequency))) for frequency in theirs.Fn]
    frequency = np.abs(ours.frequencies[places] - theirs.Fn) / theirs.Fn_std
    damping = np.abs(ours.damping_ratios[places] - theirs.Xi) / theirs.Xi_std
    worst = float(max(frequency.max(), damping.max()))
    yield Row(what="pyOMA_2's example: distance in its own deviations", value=worst, unit="sd", floor=2, aim=1)


def _seconds(work: Callable[[], object], times: int) -> float:
    taken = []
    for _ in range(times):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return min(taken)
