"""Clocks of cameras that started at different moments: what all heard, or what all saw.

Sound: generalised cross-correlation with phase transform (C. Knapp and G. Carter, 1976); sound needs 3 ms for each
metre. Flash and motion: normalised cross-correlation of brightness steps, or of how much the picture changes, on a
grid four times as fine as the pictures, the peak by a parabola. A peak that does not stand out is no answer: the
motion of a plant that vibrates on and on fits itself again one period later.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import correlate, correlation_lags

from nerfmodal.capture.signals import Signals
from nerfmodal.capture.video import Stamps, read_sound
from nerfmodal.errors import InvalidCapture
from nerfmodal.spec import CaptureSource

SOUND_RATE = 8000
FINER = 4
LEAST_OVERLAP = 0.25
"""Lags that leave less than this share of the shorter signal in common are not looked at."""
LEAST_CORRELATION = 0.5
CLEAR = 0.85
"""The second highest peak must be below this share of the highest."""
CLEAR_SOUND = 0.7
APART = 3
"""Peaks nearer than so many samples (of the coarser signal) are one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offsets:
    """By camera: the time (s) on its own clock at which the record begins, and how it was found."""

    seconds: Mapping[str, float]
    found_by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """Where two signals fit: `lag` (s), and whether nothing else fits nearly as well."""

    lag: float
    height: float
    second: float

    def stands_out(self, least: float, clear: float) -> bool:
        """Whether the peak is high enough and alone."""
        return self.height >= least and self.second < clear * self.height


def find_offsets(
    source: CaptureSource, names: Sequence[str], stamps: Sequence[Stamps], signals: Sequence[Signals], where: str
) -> Offsets:
    """Bring the clocks together by the way that the source asks for, or by the first that gives a clear answer.

    Raises
    ------
    InvalidCapture
        When a camera is unknown or no answer is clear; the message says what to give.
    """
    if source.offsets_s is not None:
        return _given(source.offsets_s, names, where)
    if source.synchronise == "clocks":
        return Offsets(seconds=dict.fromkeys(names, 0.0), found_by="clocks")
    ways: dict[str, Callable[[], list[Peak]]] = {
        "audio": lambda: [sound_peak(stamps[0], one) for one in stamps],
        "flash": lambda: [signal_peak(flashes(signals[0]), flashes(one)) for one in signals],
        "motion": lambda: [signal_peak(motion(signals[0]), motion(one)) for one in signals],
    }
    asked = list(ways) if source.synchronise == "auto" else [source.synchronise]
    if source.synchronise == "auto" and not all(one.sound for one in stamps):
        asked.remove("audio")
    unclear: list[str] = []
    for way in asked:
        peaks = ways[way]()
        least, clear = (0.0, CLEAR_SOUND) if way == "audio" else (LEAST_CORRELATION, CLEAR)
        bad = [name for name, one in zip(names, peaks, strict=True) if not one.stands_out(least, clear)]
        if not bad:
            lags = {name: one.lag for name, one in zip(names, peaks, strict=True)}
            return Offsets(seconds={name: lags[name] - lags[names[0]] for name in names}, found_by=way)
        unclear.append(f"{way} does not fit {bad[0]!r}")
    raise InvalidCapture(
        f"the cameras cannot be synchronised: {'; '.join(unclear)}.",
        where=where,
        hint="Give source.offsets_s, or source.synchronise: clocks where their time stamps are right; next time, clap "
        "or flash a light once while all film.",
    )


def flashes(signals: Signals) -> tuple[np.ndarray, np.ndarray]:
    """Steps of the brightness: all cameras see a lamp go on."""
    return signals.times[1:], np.abs(np.diff(signals.brightness))


def motion(signals: Signals) -> tuple[np.ndarray, np.ndarray]:
    """How fast the picture changes."""
    return signals.times[1:], signals.change[1:]


def signal_peak(first: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> Peak:
    """By how much (s) `other`'s clock is later than `first`'s when both show the same."""
    step = float(np.median(np.diff(first[0]))) / FINER
    a, b = (_even(times, values, step) for times, values in (first, other))
    correlation, lags = _normalised(a, b)
    peak = _highest(correlation, APART * FINER)
    start = other[0][0] - first[0][0]
    return Peak(lag=start + step * (lags[0] + peak.lag), height=peak.height, second=peak.second)


def sound_peak(first: Stamps, other: Stamps) -> Peak:
    """By how much (s) the clock of `other` is later than that of `first` at the same sound."""
    (start_a, a), (start_b, b) = read_sound(first.path, SOUND_RATE), read_sound(other.path, SOUND_RATE)
    if min(len(a), len(b)) < SOUND_RATE // 10 or not (a.any() and b.any()):
        return Peak(lag=0.0, height=0.0, second=1.0)
    size = int(2 ** np.ceil(np.log2(len(a) + len(b))))
    cross = np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size))
    correlation = np.fft.irfft(cross / np.maximum(np.abs(cross), 1e-12 * np.abs(cross).max()), size)
    correlation = np.roll(correlation, len(a))[: len(a) + len(b)]
    peak = _highest(np.abs(correlation), SOUND_RATE // 50)
    return Peak(lag=start_b - start_a + (peak.lag - len(a)) / SOUND_RATE, height=peak.height, second=peak.second)


def _given(offsets: Mapping[str, float], names: Sequence[str], where: str) -> Offsets:
    unknown = sorted(set(offsets) - set(names))
    if unknown:
        raise InvalidCapture(
            f"offsets_s names {unknown}, which are no cameras.", where=where, hint=f"They are {', '.join(names)}."
        )
    return Offsets(seconds={name: offsets.get(name, 0.0) for name in names}, found_by="given")


def _even(times: np.ndarray, values: np.ndarray, step: float) -> np.ndarray:
    return np.interp(np.arange(times[0], times[-1] + step / 2, step), times, values)


def _normalised(a: np.ndarray, b: np.ndarray) -> tuple[Float[np.ndarray, " lags"], np.ndarray]:
    """Pearson's correlation of what overlaps, by lag (samples; b later)."""
    ones_a, ones_b = np.ones(len(a)), np.ones(len(b))
    lags = correlation_lags(len(b), len(a))
    count = np.maximum(np.round(correlate(ones_b, ones_a)), 1)
    sum_a, sum_b = correlate(ones_b, a), correlate(b, ones_a)
    square_a, square_b = correlate(ones_b, a**2), correlate(b**2, ones_a)
    covariance = correlate(b, a) - sum_a * sum_b / count
    spread = np.maximum(square_a - sum_a**2 / count, 0) * np.maximum(square_b - sum_b**2 / count, 0)
    tiny = 1e-9 * max(float(spread.max()), 1e-300)
    enough = count >= LEAST_OVERLAP * min(len(a), len(b))
    kept = np.where(enough & (spread > tiny), covariance / np.sqrt(np.maximum(spread, tiny)), 0.0)
    return kept, lags


def _highest(correlation: np.ndarray, apart: int) -> Peak:
    """The highest peak, its place in samples, and the next one that is not its flank."""
    top = int(np.argmax(correlation))
    far = correlation.copy()
    far[max(0, top - apart) : top + apart + 1] = 0.0
    bend = 0.0
    if 0 < top < len(correlation) - 1:
        left, middle, right = correlation[top - 1 : top + 2]
        bottom = left - 2 * middle + right
        bend = 0.5 * (left - right) / bottom if bottom < 0 else 0.0
    return Peak(lag=top + float(bend), height=float(correlation[top]), second=float(far.max(initial=0.0)))
