"""Modes of the whole structure: modes of several organs that are one motion.

Organs move as one where a mode of each has the same frequency and damping within their standard deviations, and where
their coordinates keep one phase through the record, 0 or 180 degrees (a real mode). Equal leaves have equal frequencies
without moving as one: their phases are arbitrary, or drift. The phase is followed through segments of the record, each
fitted with a sinusoid at the common frequency, so that lost frames and uneven times do no harm.
"""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from jaxtyping import Complex, Float

from nerfmodal.types import OrganResult, StructureMode, Verdict

WITHIN_SDS = 3.0
SAME_HZ = 0.002
SAME_DAMPING = 0.001
"""Differences below these are none, however small the stated deviations are."""
COHERENT = 0.97
PHASE_DEG = 20.0
"""Largest distance of the phase between two organs from 0 or 180 degrees."""
MOST_SEGMENTS = 12
FEWEST_SEGMENTS = 3
FEWEST_FRAMES = 4
"""Frames in a segment whose sinusoid is fitted."""


def structure_modes(organs: Sequence[OrganResult], times: Float[np.ndarray, " frames"]) -> tuple[StructureMode, ...]:
    """The motions that two organs or more share, by frequency.

    Parameters
    ----------
    organs
        What was identified of each; rejected modes are left out.
    times
        Instants of the frames, seconds.
    """
    members = [
        (organ, mode)
        for organ in organs
        for mode in range(len(organ.model.frequencies))
        if organ.model.quality[mode].verdict is not Verdict.REJECTED
    ]
    members.sort(key=lambda member: -_strength(*member))
    found = []
    while members:
        first = members.pop(0)
        together = _one_each([first, *(other for other in members if _is_one_motion(first, other, times))])
        members = [other for other in members if not _among(other, together)]
        if len(together) > 1:
            found.append(_joined(together, times))
    return tuple(sorted(found, key=lambda mode: mode.frequency))


def phasors(
    coordinate: Float[np.ndarray, " frames"], times: Float[np.ndarray, " frames"], frequency: float
) -> Complex[np.ndarray, " segments"]:
    """Amplitude and phase of the line at `frequency` (Hz) in every segment of the record; 0 where frames lack."""
    span = float(times[-1] - times[0])
    count = int(np.clip(np.floor(span * frequency), FEWEST_SEGMENTS, MOST_SEGMENTS))
    segment = np.minimum((count * (times - times[0]) / max(span, 1e-12)).astype(int), count - 1)
    turning = np.exp(2j * np.pi * frequency * times)
    design = np.column_stack([turning.real, -turning.imag])  # q = Re(a exp(2 pi i f t))
    found = np.zeros(count, dtype=complex)
    for place in range(count):
        mine = (segment == place) & np.isfinite(coordinate)
        if np.count_nonzero(mine) >= FEWEST_FRAMES:
            parts, *_ = np.linalg.lstsq(design[mine], coordinate[mine], rcond=None)
            found[place] = parts[0] + 1j * parts[1]
    return found


def _strength(organ: OrganResult, mode: int) -> float:
    return float(np.nanstd(organ.model.coordinates[:, mode]))


Member = tuple[OrganResult, int]


def _is_one_motion(first: Member, second: Member, times: np.ndarray) -> bool:
    (a, i), (b, j) = first, second
    if a.organ == b.organ or not _same_pole(a, i, b, j):
        return False
    ratio, coherence = _relation(first, second, times)
    off = abs(np.degrees(np.angle(ratio)))
    return bool(coherence >= COHERENT and min(off, 180.0 - off) <= PHASE_DEG)


def _same_pole(a: OrganResult, i: int, b: OrganResult, j: int) -> bool:
    def near(value: float, other: float, deviations: tuple[float, float], least: float) -> bool:
        spread = float(np.nan_to_num(np.hypot(*deviations)))
        return bool(abs(value - other) <= max(WITHIN_SDS * spread, least))

    p, q = a.model, b.model
    return near(p.frequencies[i], q.frequencies[j], (p.frequency_stds[i], q.frequency_stds[j]), SAME_HZ) and near(
        p.damping_ratios[i], q.damping_ratios[j], (p.damping_stds[i], q.damping_stds[j]), SAME_DAMPING
    )


def _relation(first: Member, second: Member, times: np.ndarray) -> tuple[complex, float]:
    """Second over first as a complex number, and how constant that is through the record (1: wholly)."""
    frequency = float(first[0].model.frequencies[first[1]])
    one, other = (phasors(organ.model.coordinates[:, mode], times, frequency) for organ, mode in (first, second))
    seen = (one != 0) & (other != 0)
    product = np.vdot(one[seen], other[seen])
    energies = float((np.abs(one[seen]) ** 2).sum()), float((np.abs(other[seen]) ** 2).sum())
    if min(energies) <= 0:
        return 0j, 0.0
    return complex(product / energies[0]), float(abs(product) / np.sqrt(energies[0] * energies[1]))


def _one_each(members: list[Member]) -> list[Member]:
    """At most one mode of an organ: the first, which is the strongest."""
    by_organ = sorted(members, key=lambda member: member[0].organ)
    strongest = [
        max(group, key=lambda one: _strength(*one)) for _, group in groupby(by_organ, lambda one: one[0].organ)
    ]
    return sorted(strongest, key=lambda member: -_strength(*member))


def _among(one: Member, members: list[Member]) -> bool:
    return any(one[0].organ == other.organ and one[1] == mode for other, mode in members)


def _joined(members: list[Member], times: np.ndarray) -> StructureMode:
    relations = [_relation(members[0], member, times) for member in members]
    ratios = np.array([ratio.real for ratio, _ in relations])
    ratios = ratios / ratios[np.argmax(np.abs(ratios))]
    coordinates = np.stack([organ.model.coordinates[:, mode] for organ, mode in members], axis=1)
    frequency, frequency_std = _mean([(o.model.frequencies[k], o.model.frequency_stds[k]) for o, k in members])
    damping, damping_std = _mean([(o.model.damping_ratios[k], o.model.damping_stds[k]) for o, k in members])
    positions, shape = _global_shape(members, ratios)
    accepted = all(organ.model.quality[mode].verdict is Verdict.ACCEPTED for organ, mode in members)
    return StructureMode(
        frequency=frequency,
        frequency_std=frequency_std,
        damping_ratio=damping,
        damping_std=damping_std,
        organs=tuple(organ.organ for organ, _ in members),
        modes=tuple(mode for _, mode in members),
        amplitudes=ratios,
        phases=np.array([np.angle(ratio) for ratio, _ in relations]),
        coherences=np.array([coherence for _, coherence in relations]),
        coordinates=coordinates @ ratios / (ratios @ ratios),
        positions=positions,
        shape=shape,
        verdict=Verdict.ACCEPTED if accepted else Verdict.DOUBTFUL,
    )


def _global_shape(members: list[Member], ratios: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sensors of all organs at rest and how they move (sensors, 3), world; the largest organ moves as its own mode."""
    positions = [organ.displacement.sensors.positions for organ, _ in members]
    vectors = [
        ratio * organ.model.mode_shapes[:, :, mode] @ organ.displacement.directions
        for (organ, mode), ratio in zip(members, ratios, strict=True)
    ]
    return np.concatenate(positions), np.concatenate(vectors)


def _mean(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean weighted by inverse variances, and its deviation; the plain mean where a deviation is not known."""
    estimates, deviations = np.array(values).T
    if not (np.isfinite(deviations).all() and (deviations > 0).all()):
        return float(estimates.mean()), float("nan")
    weights = 1.0 / deviations**2
    return float(estimates @ weights / weights.sum()), float(1.0 / np.sqrt(weights.sum()))
