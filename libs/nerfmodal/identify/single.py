"""Models that rest on one opinion: complexity pursuit where it is asked for, the subspace for ambient records."""

import numpy as np

from nerfmodal.identify.assemble import Evidence, agreement_with, build_model, energy_shares, paired_mac
from nerfmodal.identify.lines import damped_columns
from nerfmodal.identify.shapes import rotate_to_real, unit_max
from nerfmodal.identify.subspace import ambient_deviations
from nerfmodal.identify.uncertainty import cramer_rao
from nerfmodal.identify.verdicts import ALIAS_SHARE, FEWEST_PERIODS
from nerfmodal.types import ModalModel, ModeQuality, Opinion, Reason, Verdict

FEWEST_AMBIENT_PERIODS = 30.0
"""An ambient record with fewer periods of a mode says little of its damping (error above 70 % at 1 %)."""


def model_of_pursuit(opinion: Opinion, evidence: Evidence) -> ModalModel:
    """The modes of complexity pursuit alone, as the paper has them, with the Cramér-Rao bound's deviations.

    A source of which the damped-sinusoid fit knows nothing is doubtful.
    """
    sorted_opinion = _sorted(opinion)
    fit = evidence.fit
    fitted, _ = unit_max(rotate_to_real(evidence.components @ fit.amplitudes.T))
    frequencies, shapes = sorted_opinion.frequencies, _flat(sorted_opinion)
    alike = paired_mac(frequencies, shapes, fit.frequencies, fitted, evidence.duration)
    deviations = [
        _bound(evidence, *mode)
        for mode in zip(sorted_opinion.coordinates.T, frequencies, sorted_opinion.damping_ratios, strict=True)
    ]
    reasons: list[tuple[Reason, ...]] = [() if each is not None else (Reason.METHODS_DISAGREE,) for each in alike]
    return _model(evidence, sorted_opinion, deviations, alike, reasons, doubting=frozenset(Reason))


def model_of_subspace(opinion: Opinion, evidence: Evidence, other: Opinion) -> ModalModel:
    """The modes of the subspace method for an ambient record, with the deviations that such a record allows."""
    alike = agreement_with(evidence, opinion.frequencies, _flat(opinion), other)
    deviations = [
        ambient_deviations(float(frequency), float(ratio), evidence.duration)
        for frequency, ratio in zip(opinion.frequencies, opinion.damping_ratios, strict=True)
    ]
    reasons = [
        _reasons(float(frequency), each, evidence) for frequency, each in zip(opinion.frequencies, alike, strict=True)
    ]
    return _model(evidence, opinion, deviations, alike, reasons, doubting=frozenset({Reason.RECORD_TOO_SHORT}))


def _reasons(frequency: float, alike: float | None, evidence: Evidence) -> tuple[Reason, ...]:
    periods = max(FEWEST_AMBIENT_PERIODS, FEWEST_PERIODS)
    tests = {
        Reason.RECORD_TOO_SHORT: frequency * evidence.duration < periods,
        Reason.ALIAS_SUSPECT: frequency > ALIAS_SHARE * evidence.displacement.frame_rate,
        Reason.METHODS_DISAGREE: alike is None,
    }
    return tuple(reason for reason, holds in tests.items() if holds)


def _model(
    evidence: Evidence,
    opinion: Opinion,
    deviations: list[tuple[float, float]],
    alike: list[float | None],
    reasons: list[tuple[Reason, ...]],
    *,
    doubting: frozenset[Reason],
) -> ModalModel:
    shapes = _flat(opinion)
    energy = energy_shares(evidence, shapes, opinion.coordinates)
    quality = tuple(
        ModeQuality(
            energy_share=float(energy[mode]),
            mpc=1.0,
            mac_between_methods=alike[mode],
            verdict=Verdict.DOUBTFUL if doubting.intersection(reasons[mode]) else Verdict.ACCEPTED,
            reasons=reasons[mode],
        )
        for mode in range(len(opinion.frequencies))
    )
    frequency_stds, damping_stds = np.array(deviations).reshape(-1, 2).T
    return build_model(
        evidence,
        opinion.frequencies,
        frequency_stds,
        opinion.damping_ratios,
        damping_stds,
        shapes,
        opinion.coordinates,
        quality,
    )


def _sorted(opinion: Opinion) -> Opinion:
    """By frequency, with a damping ratio of 0 where the decrement gave none."""
    order = np.argsort(opinion.frequencies, kind="stable")
    return Opinion(
        method=opinion.method,
        frequencies=opinion.frequencies[order],
        damping_ratios=np.clip(np.nan_to_num(opinion.damping_ratios[order]), -0.99, 0.99),
        mode_shapes=opinion.mode_shapes[:, :, order],
        coordinates=opinion.coordinates[:, order],
    )


def _flat(opinion: Opinion) -> np.ndarray:
    sensors, axes, modes = opinion.mode_shapes.shape
    return opinion.mode_shapes.reshape(sensors * axes, modes)


def _bound(evidence: Evidence, series: np.ndarray, frequency: float, ratio: float) -> tuple[float, float]:
    """The Cramér-Rao bound with the amplitude and the noise that the source itself shows."""
    columns = damped_columns(evidence.displacement.times, np.array([[frequency, ratio]]))
    solution = np.linalg.lstsq(columns, series, rcond=None)[0]
    noise = float(np.std(series - columns @ solution)) + 1e-300
    return cramer_rao(evidence.displacement.times, frequency, ratio, float(np.hypot(*solution[1:])) / noise + 1e-12)
