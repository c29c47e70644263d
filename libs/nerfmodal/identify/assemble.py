"""From the fitted lines to the one modal model: shapes, coordinates, energy, consensus, verdict."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.lines import damped_columns
from nerfmodal.identify.metrics import mpc
from nerfmodal.identify.readings import Consensus, Reading, Record, consensus, normalised
from nerfmodal.identify.shapes import rotate_to_real
from nerfmodal.identify.sinusoids import SinusoidFit
from nerfmodal.identify.verdicts import combination_lines, reasons_of, verdict_of
from nerfmodal.types import ModalModel, ModeQuality, Outcome

INDEPENDENT = 0.1
"""Smallest singular value of the unit shapes, over the largest, at which they still tell their coordinates apart."""
CLEAR = 3.0
"""Amplitude over residual from which a line is no drift of the clouds' errors."""


def read_fit(record: Record, fit: SinusoidFit) -> Reading:
    """The damped-sinusoid fit as one of the readings."""
    local, shapes, _ = normalised(record.axes, rotate_to_real(fit.amplitudes.T))
    return Reading(
        method="damped_sinusoids",
        frequencies=fit.frequencies,
        damping_ratios=fit.damping_ratios,
        local=local,
        shapes=shapes,
        coordinates=_coordinates(record, fit, local),
    )


def model_of_fit(record: Record, fit: SinusoidFit, reading: Reading, others: Sequence[Reading]) -> ModalModel:
    """The modes of the damped-sinusoid fit, judged with the others' opinions."""
    phases = np.array([mpc(local) for local in fit.amplitudes])
    quality = _judge(record, fit, reading, phases, consensus(reading, others, record.duration))
    return build_model(record, reading, fit.frequency_stds, fit.damping_stds, quality)


def build_model(
    record: Record,
    reading: Reading,
    frequency_stds: Float[np.ndarray, " modes"],
    damping_stds: Float[np.ndarray, " modes"],
    quality: tuple[ModeQuality, ...],
) -> ModalModel:
    """The model of a reading's modes; its outcome is NO_MOTION if there are none."""
    return ModalModel(
        frequencies=reading.frequencies,
        frequency_stds=frequency_stds,
        damping_ratios=reading.damping_ratios,
        damping_stds=damping_stds,
        mode_shapes=reading.opinion(record.displacement).mode_shapes,
        coordinates=reading.coordinates,
        quality=quality,
        outcome=Outcome.OK if len(reading.frequencies) else Outcome.NO_MOTION,
    )


def energy_shares(record: Record, reading: Reading) -> Float[np.ndarray, " modes"]:
    """Each mode's share of the displacement's energy; shapes that are not orthogonal may sum to more than 1."""
    valid = record.displacement.valid
    total = (record.axes.scores[valid] ** 2).sum()
    sizes = (reading.coordinates[valid] ** 2).sum(axis=0) * (reading.local**2).sum(axis=0)
    return np.asarray(sizes / max(total, 1e-300))


def _coordinates(record: Record, fit: SinusoidFit, local: np.ndarray) -> np.ndarray:
    """The fitted lines, and by least squares what they leave; in lost frames the lines alone.

    Where shapes are independent this is the least-squares q of D ≈ q Phi. Where one is a mixture of the others (more
    modes than shapes can be told apart) what is left is shared out, and does not drown the lines.
    """
    lines = _predicted(record.displacement.times, fit, local)
    sizes = np.sqrt((local**2).sum(axis=0))
    weights = np.linalg.pinv(local / sizes, rcond=INDEPENDENT).T / sizes
    left = record.axes.scores[:, : len(local)] - lines @ local.T
    return np.asarray(lines + np.nan_to_num(left) @ weights)


def _predicted(times: np.ndarray, fit: SinusoidFit, local: np.ndarray) -> np.ndarray:
    scale = (fit.amplitudes * local.T).sum(axis=1) / (local**2).sum(axis=0)
    lines = np.column_stack([fit.frequencies, fit.damping_ratios])
    columns = damped_columns(np.concatenate([fit.times[:1], times]), lines)[1:]
    return np.asarray(columns[:, 1::2] * scale.real - columns[:, 2::2] * scale.imag)


def _amplitudes(record: Record, fit: SinusoidFit) -> np.ndarray:
    """Largest first amplitude of each line anywhere on the organ, metres."""
    parts = record.axes.lift(np.hstack([fit.amplitudes.T.real, fit.amplitudes.T.imag]))
    np.square(parts, out=parts)
    modes = len(fit.amplitudes)
    return np.sqrt(np.array([(parts[:, mode] + parts[:, modes + mode]).max() for mode in range(modes)]))


def _residual_sizes(fit: SinusoidFit, local: np.ndarray) -> np.ndarray:
    """Standard deviation along each shape of what the fit leaves, metres of modal coordinate."""
    weights = local / (local**2).sum(axis=0)
    return np.asarray(np.sqrt(np.einsum("cm,cd,dm->m", weights, fit.noise, weights)))


def _judge(
    record: Record, fit: SinusoidFit, reading: Reading, phases: np.ndarray, agreed: list[Consensus]
) -> tuple[ModeQuality, ...]:
    energy, residuals = energy_shares(record, reading), _residual_sizes(fit, reading.local)
    amplitudes = _amplitudes(record, fit)
    lonely = np.array([one.mac is None for one in agreed], dtype=bool)
    combination = combination_lines(fit.frequencies, fit.frequency_stds, amplitudes, lonely)
    lag_one = fit.lag_one(amplitudes >= CLEAR * residuals)
    quality = []
    for mode in range(len(fit.frequencies)):
        reasons = reasons_of(
            frequency=float(fit.frequencies[mode]),
            damping_ratio=float(fit.damping_ratios[mode]),
            damping_std=float(fit.damping_stds[mode]),
            amplitude=float(amplitudes[mode]),
            strongest=float(amplitudes.max()),
            residual=float(residuals[mode]),
            mpc=float(phases[mode]),
            agreement=agreed[mode].mac,
            combination=combination[mode],
            duration=record.duration,
            frame_rate=record.displacement.frame_rate,
            lag_one=lag_one,
        )
        quality.append(
            ModeQuality(
                energy_share=float(energy[mode]),
                mpc=float(phases[mode]),
                mac_between_methods=agreed[mode].mac,
                agreeing=agreed[mode].methods,
                verdict=verdict_of(reasons, float(amplitudes[mode] / max(residuals[mode], 1e-300))),
                reasons=reasons,
            )
        )
    return tuple(quality)
