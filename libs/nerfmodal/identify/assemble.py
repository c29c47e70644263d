"""From what the estimators found to the one modal model: shapes, coordinates, energy, agreement, verdict."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.lines import damped_columns
from nerfmodal.identify.metrics import mac_matrix, mpc, pair
from nerfmodal.identify.shapes import coordinates_of, rotate_to_real, unit_max
from nerfmodal.identify.sinusoids import SinusoidFit
from nerfmodal.identify.verdicts import combination_lines, reasons_of, verdict_of
from nerfmodal.types import DisplacementMatrix, ModalModel, ModeQuality, Opinion, Outcome

ALIKE = 0.8
"""MAC from which two methods are said to agree on a mode."""
AGREE_SHARE = 0.03
"""They may differ in frequency by this share, or by half a line's width (0.5 / record length)."""

CLEAR = 3.0
"""Amplitude over residual from which a line is no drift of the clouds' errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The record in its principal components (dofs, channels), its scores, and the lines fitted to them."""

    displacement: DisplacementMatrix
    components: Float[np.ndarray, "dofs channels"]
    scores: Float[np.ndarray, "frames rank"]
    fit: SinusoidFit

    @property
    def duration(self) -> float:
        """Length of the record, seconds: the last frame lasts as long as the others."""
        times = self.displacement.times
        return float(times[-1] - times[0]) + 1.0 / self.displacement.frame_rate


def model_of_fit(evidence: Evidence, other: Opinion) -> ModalModel:
    """The modes of the damped-sinusoid fit, judged with `other`'s opinion."""
    fit = evidence.fit
    complex_shapes = evidence.components @ fit.amplitudes.T
    shapes, _ = unit_max(rotate_to_real(complex_shapes))
    coordinates = _coordinates(evidence, shapes)
    phases = np.array([mpc(shape) for shape in complex_shapes.T])
    amplitudes = np.abs(complex_shapes).max(axis=0)
    agreement = agreement_with(evidence, fit.frequencies, shapes, other)
    return build_model(
        evidence,
        fit.frequencies,
        fit.frequency_stds,
        fit.damping_ratios,
        fit.damping_stds,
        shapes,
        coordinates,
        _judge(evidence, shapes, coordinates, amplitudes, phases, agreement),
    )


def build_model(
    evidence: Evidence,
    frequencies: Float[np.ndarray, " modes"],
    frequency_stds: Float[np.ndarray, " modes"],
    ratios: Float[np.ndarray, " modes"],
    damping_stds: Float[np.ndarray, " modes"],
    shapes: Float[np.ndarray, "dofs modes"],
    coordinates: Float[np.ndarray, "frames modes"],
    quality: tuple[ModeQuality, ...],
) -> ModalModel:
    """The model of these modes; its outcome is NO_MOTION if there are none."""
    sensors, axes = len(evidence.displacement.sensors.positions), len(evidence.displacement.directions)
    return ModalModel(
        frequencies=frequencies,
        frequency_stds=frequency_stds,
        damping_ratios=ratios,
        damping_stds=damping_stds,
        mode_shapes=shapes.reshape(sensors, axes, -1),
        coordinates=coordinates,
        quality=quality,
        outcome=Outcome.OK if len(frequencies) else Outcome.NO_MOTION,
    )


def _coordinates(evidence: Evidence, shapes: np.ndarray) -> np.ndarray:
    """q by least squares in the seen frames; in lost ones what the fitted lines say."""
    local = evidence.components.T @ shapes
    coordinates = coordinates_of(evidence.scores[:, : local.shape[0]], local)
    lost = ~evidence.displacement.valid
    if lost.any() and shapes.shape[1]:
        coordinates[lost] = _predicted(evidence, local)[lost]
    return coordinates


def _predicted(evidence: Evidence, local: np.ndarray) -> np.ndarray:
    fit = evidence.fit
    scale = (fit.amplitudes * local.T).sum(axis=1) / (local**2).sum(axis=0)
    lines = np.column_stack([fit.frequencies, fit.damping_ratios])
    instants = np.concatenate([fit.times[:1], evidence.displacement.times])
    columns = damped_columns(instants, lines)[1:]
    return np.asarray(columns[:, 1::2] * scale.real - columns[:, 2::2] * scale.imag)


def energy_shares(
    evidence: Evidence, shapes: Float[np.ndarray, "dofs modes"], coordinates: Float[np.ndarray, "frames modes"]
) -> Float[np.ndarray, " modes"]:
    """Each mode's share of the displacement's energy; shapes that are not orthogonal may sum to more than 1."""
    valid = evidence.displacement.valid
    total = (evidence.scores[valid] ** 2).sum()
    return np.asarray((coordinates[valid] ** 2).sum(axis=0) * (shapes**2).sum(axis=0) / max(total, 1e-300))


def _residual_sizes(evidence: Evidence, shapes: np.ndarray) -> np.ndarray:
    """Standard deviation along each shape of what the fit leaves, metres of modal coordinate."""
    weights = np.linalg.pinv(evidence.components.T @ shapes)
    return np.asarray(np.sqrt(np.einsum("mc,cd,md->m", weights, evidence.fit.noise, weights)))


def agreement_with(
    evidence: Evidence,
    frequencies: Float[np.ndarray, " modes"],
    shapes: Float[np.ndarray, "dofs modes"],
    other: Opinion,
) -> list[float | None]:
    """MAC with the mode that `other` has at the same frequency with a like shape; None without one."""
    theirs = other.mode_shapes.reshape(-1, len(other.frequencies))
    return paired_mac(frequencies, shapes, other.frequencies, theirs, evidence.duration)


def paired_mac(
    frequencies: Float[np.ndarray, " modes"],
    shapes: Float[np.ndarray, "dofs modes"],
    others: Float[np.ndarray, " others"],
    other_shapes: Float[np.ndarray, "dofs others"],
    duration: float,
) -> list[float | None]:
    """MAC with the mode of the other method that is at the same frequency and alike; None without one."""
    likeness = mac_matrix(shapes, other_shapes)
    width = max(0.5 / duration, AGREE_SHARE * float(frequencies.max(initial=0.0)))
    paired = dict(pair(frequencies, others, likeness, within_hz=width))
    result: list[float | None] = []
    for mode, frequency in enumerate(frequencies):
        partner = paired.get(mode)
        near = partner is not None and abs(others[partner] - frequency) <= max(0.5 / duration, AGREE_SHARE * frequency)
        alike = float(likeness[mode, partner]) if partner is not None and near else 0.0
        result.append(alike if alike >= ALIKE else None)
    return result


def _judge(
    evidence: Evidence,
    shapes: np.ndarray,
    coordinates: np.ndarray,
    amplitudes: np.ndarray,
    phases: np.ndarray,
    agreement: list[float | None],
) -> tuple[ModeQuality, ...]:
    fit = evidence.fit
    energy = energy_shares(evidence, shapes, coordinates)
    residuals = _residual_sizes(evidence, shapes)
    combination = combination_lines(fit.frequencies, fit.frequency_stds, amplitudes)
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
            agreement=agreement[mode],
            combination=combination[mode],
            duration=evidence.duration,
            frame_rate=evidence.displacement.frame_rate,
            lag_one=lag_one,
        )
        quality.append(
            ModeQuality(
                energy_share=float(energy[mode]),
                mpc=float(phases[mode]),
                mac_between_methods=agreement[mode],
                verdict=verdict_of(reasons, float(amplitudes[mode] / max(residuals[mode], 1e-300))),
                reasons=reasons,
            )
        )
    return tuple(quality)
