"""Models that rest on one opinion: complexity pursuit where it is asked for, the subspace for ambient records."""

from collections.abc import Sequence

import numpy as np

from nerfmodal.bounds import ambient_deviations, cramer_rao
from nerfmodal.identify.assemble import build_model, energy_shares
from nerfmodal.identify.lines import damped_columns
from nerfmodal.identify.readings import Consensus, Reading, Record, consensus
from nerfmodal.identify.verdicts import ALIAS_SHARE, FEWEST_PERIODS
from nerfmodal.types import ModalModel, ModeQuality, Reason, Verdict

FEWEST_AMBIENT_PERIODS = 30.0
"""An ambient record with fewer periods of a mode says little of its damping (error above 70 % at 1 %)."""


def model_of_pursuit(record: Record, reading: Reading, others: Sequence[Reading]) -> ModalModel:
    """The modes of complexity pursuit alone, as the paper has them, with the Cramér-Rao bound's deviations.

    A source of which the other methods know nothing is doubtful.
    """
    ordered = _sorted(reading)
    agreed = consensus(ordered, others, record.duration)
    deviations = [
        _bound(record, *mode)
        for mode in zip(ordered.coordinates.T, ordered.frequencies, ordered.damping_ratios, strict=True)
    ]
    reasons: list[tuple[Reason, ...]] = [() if each.methods else (Reason.METHODS_DISAGREE,) for each in agreed]
    return _model(record, ordered, deviations, agreed, reasons, doubting=frozenset(Reason))


def model_of_subspace(record: Record, reading: Reading, others: Sequence[Reading]) -> ModalModel:
    """The modes of the subspace method for an ambient record, with the deviations that such a record allows."""
    agreed = consensus(reading, others, record.duration)
    deviations = [
        ambient_deviations(float(frequency), float(ratio), record.duration)
        for frequency, ratio in zip(reading.frequencies, reading.damping_ratios, strict=True)
    ]
    reasons = [
        _reasons(float(frequency), each, record) for frequency, each in zip(reading.frequencies, agreed, strict=True)
    ]
    return _model(record, reading, deviations, agreed, reasons, doubting=frozenset({Reason.RECORD_TOO_SHORT}))


def _reasons(frequency: float, agreed: Consensus, record: Record) -> tuple[Reason, ...]:
    periods = max(FEWEST_AMBIENT_PERIODS, FEWEST_PERIODS)
    tests = {
        Reason.RECORD_TOO_SHORT: frequency * record.duration < periods,
        Reason.ALIAS_SUSPECT: frequency > ALIAS_SHARE * record.displacement.frame_rate,
        Reason.METHODS_DISAGREE: not agreed.methods,
    }
    return tuple(reason for reason, holds in tests.items() if holds)


def _model(
    record: Record,
    reading: Reading,
    deviations: list[tuple[float, float]],
    agreed: list[Consensus],
    reasons: list[tuple[Reason, ...]],
    *,
    doubting: frozenset[Reason],
) -> ModalModel:
    energy = energy_shares(record, reading)
    quality = tuple(
        ModeQuality(
            energy_share=float(energy[mode]),
            mpc=1.0,
            mac_between_methods=agreed[mode].mac,
            agreeing=agreed[mode].methods,
            verdict=Verdict.DOUBTFUL if doubting.intersection(reasons[mode]) else Verdict.ACCEPTED,
            reasons=reasons[mode],
        )
        for mode in range(len(reading.frequencies))
    )
    frequency_stds, damping_stds = np.array(deviations).reshape(-1, 2).T
    return build_model(record, reading, frequency_stds, damping_stds, quality)


def _sorted(reading: Reading) -> Reading:
    """By frequency, with a damping ratio of 0 where the decrement gave none."""
    order = np.argsort(reading.frequencies, kind="stable")
    return Reading(
        method=reading.method,
        frequencies=reading.frequencies[order],
        damping_ratios=np.clip(np.nan_to_num(reading.damping_ratios[order]), -0.99, 0.99),
        local=reading.local[:, order],
        shapes=reading.shapes[:, order],
        coordinates=reading.coordinates[:, order],
    )


def _bound(record: Record, series: np.ndarray, frequency: float, ratio: float) -> tuple[float, float]:
    """The Cramér-Rao bound with the amplitude and the noise that the source itself shows."""
    times = record.displacement.times
    columns = damped_columns(times, np.array([[frequency, ratio]]))
    solution = np.linalg.lstsq(columns, series, rcond=None)[0]
    noise = float(np.std(series - columns @ solution)) + 1e-300
    return cramer_rao(times, frequency, ratio, float(np.hypot(*solution[1:])) / noise + 1e-12)
