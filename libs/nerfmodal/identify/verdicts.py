"""What is said of a mode: accepted, doubtful or rejected, always with its reasons.

A line at a sum or difference of two stronger ones is no mode of the structure but of the geometry (a swing of large
angle shows its second harmonic). The other reasons leave the mode in the list as doubtful; disagreement of the
methods and a frequency near Nyquist are stated with an accepted mode: complexity pursuit is the weaker of the two on
short records, and an alias cannot be seen.
"""

import numpy as np
from jaxtyping import Bool, Float

from nerfmodal.types import Reason, Verdict

COMBINATION_HZ = 0.08
COMBINATION_SDS = 3.0
COMBINATION_SHARE = 0.20
LONELY_COMBINATION_SHARE = 0.5
"""Of the geometric mean of two lines that other methods find too; a line that none finds there is their combination."""
WEAK_SHARE = 0.02
LONELY_SHARE = 0.1
"""A mode that no other method finds must be stronger, as a share of the strongest."""
FEWEST_PERIODS = 2.0
ALIAS_SHARE = 0.45
NEGATIVE_SDS = 3.0
NEGATIVE_DAMPING = -0.002
"""Nearer to zero an undamped mode is meant, whatever the deviations say."""
LOWEST_MPC = 0.5
DRIFT_LAG = 0.2
LOWEST_TO_RESIDUAL = 1.0
"""Peak of a modal coordinate over the residual's standard deviation along its shape."""
SAFE_TO_RESIDUAL = 5.0
"""Above this a drift of the record does not throw doubt on a mode."""

REJECTING = frozenset({Reason.HARMONIC})
STATED_ONLY = frozenset({Reason.METHODS_DISAGREE, Reason.ALIAS_SUSPECT})


def combination_lines(
    frequencies: Float[np.ndarray, " modes"],
    deviations: Float[np.ndarray, " modes"],
    amplitudes: Float[np.ndarray, " modes"],
    lonely: Bool[np.ndarray, " modes"],
) -> list[bool]:
    """Which lines lie at |f_a ± f_b| (2f included) of two lines, or at 3f of one, that are five times stronger.

    Where no other method finds the line (`lonely`), but both of the others, less will do: a product of two motions is
    as large as the one share of the other, and may pass a weak one of them.
    """
    return [
        _is_third(line, frequencies, deviations, amplitudes)
        or any(
            _meets(frequencies[line], frequencies[a], frequencies[b], deviations[line])
            for a in range(len(frequencies))
            for b in range(a, len(frequencies))
            if _outweigh(a, b, line, amplitudes, lonely)
        )
        for line in range(len(frequencies))
    ]


def _outweigh(
    first: int, second: int, line: int, amplitudes: Float[np.ndarray, " modes"], lonely: Bool[np.ndarray, " modes"]
) -> bool:
    """Whether two lines are so strong that a third may be their combination."""
    if amplitudes[line] < COMBINATION_SHARE * min(amplitudes[first], amplitudes[second]):
        return True
    if line in (first, second) or not lonely[line] or lonely[first] or lonely[second]:
        return False
    return bool(amplitudes[line] < LONELY_COMBINATION_SHARE * np.sqrt(amplitudes[first] * amplitudes[second]))


def _is_third(
    line: int,
    frequencies: Float[np.ndarray, " modes"],
    deviations: Float[np.ndarray, " modes"],
    amplitudes: Float[np.ndarray, " modes"],
) -> bool:
    within = max(COMBINATION_HZ, COMBINATION_SDS * float(deviations[line]))
    stronger = amplitudes[line] < COMBINATION_SHARE * amplitudes
    return bool(np.any(stronger & (np.abs(3 * frequencies - frequencies[line]) <= within)))


def _meets(line: float, first: float, second: float, deviation: float) -> bool:
    within = max(COMBINATION_HZ, COMBINATION_SDS * deviation)
    return bool(min(abs(first + second - line), abs(abs(first - second) - line)) <= within)


def reasons_of(
    *,
    frequency: float,
    damping_ratio: float,
    damping_std: float,
    amplitude: float,
    strongest: float,
    residual: float,
    mpc: float,
    agreement: float | None,
    combination: bool,
    duration: float,
    frame_rate: float,
    lag_one: float,
) -> tuple[Reason, ...]:
    """Every reason that holds, in a fixed order.

    `amplitude`, `strongest` and `residual` (standard deviation) are of modal coordinates in metres; `agreement` is
    the MAC with the other method's mode, None if it has none there.
    """
    tests = {
        Reason.HARMONIC: combination,
        Reason.RECORD_TOO_SHORT: frequency * duration < FEWEST_PERIODS,
        Reason.ALIAS_SUSPECT: frequency > ALIAS_SHARE * frame_rate,
        Reason.NEGATIVE_DAMPING: damping_ratio < min(-NEGATIVE_SDS * damping_std, NEGATIVE_DAMPING),
        Reason.LOW_MPC: mpc < LOWEST_MPC,
        Reason.WEAK: amplitude < (WEAK_SHARE if agreement is not None else LONELY_SHARE) * strongest,
        Reason.FIT_RESIDUAL_HIGH: amplitude < LOWEST_TO_RESIDUAL * residual,
        Reason.DRIFT: lag_one > DRIFT_LAG,
        Reason.METHODS_DISAGREE: agreement is None,
    }
    return tuple(reason for reason, holds in tests.items() if holds)


def verdict_of(reasons: tuple[Reason, ...], amplitude_to_residual: float) -> Verdict:
    """Rejected by a rejecting reason, doubtful by any other that is not merely stated."""
    if REJECTING.intersection(reasons):
        return Verdict.REJECTED
    stated = STATED_ONLY | ({Reason.DRIFT} if amplitude_to_residual >= SAFE_TO_RESIDUAL else set())
    return Verdict.DOUBTFUL if set(reasons) - stated else Verdict.ACCEPTED
