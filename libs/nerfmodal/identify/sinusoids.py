"""The default estimator: a whitened joint fit of damped sinusoids to all channels ("gls").

Every channel (principal-component score) is a constant plus the same modes, each with its own amplitude and phase:

    y_c(t) = k_c + Σ_j exp(-ζ_j ω_j t) (a_jc cos ω_dj t + b_jc sin ω_dj t) + e_c(t)

Variable projection: frequencies and damping ratios by Levenberg-Marquardt, the rest by least squares inside. The
channels are whitened with the covariance of the residual (generalised least squares). Modes are added one at a time
while the best line on a grid beats all shuffles of the frames. Time stamps are arbitrary: a lost frame is simply
absent. It is never started from a Hann-windowed FFT, which erases the early decay.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy import linalg

from nerfmodal.identify.lines import Grid, candidate_grid, damped_columns, find_line, whitened
from nerfmodal.identify.projection import Bounds, refine
from nerfmodal.identify.windows import Windows, windows_of

LOWEST_HZ = 0.35
HIGHEST_SHARE = 0.47
"""Of the frame rate: the search ends a little above 0.45, so that a line there is seen, and flagged (`verdicts`)."""
DAMPING_RANGE = (-0.05, 0.20)
MOST_ROUNDS = 15
"""Re-estimates of the residual's covariance: after two the strongest line can still be ten deviations off."""
SETTLED = np.array([1e-5, 1e-6])
"""Change of (frequency Hz, damping ratio) below which another round is worth nothing."""
CLOSEST = 0.1
"""Two lines closer than this over the record's length are one line split in two."""
LONG_S = 12.0
"""A longer record is searched by windows: its sharp lines fall between those of the grid."""
WIDE = 2e4
"""Hz x frames from which the grid is a waste of time."""
NOTHING_LEFT = 1e-10
"""Share of the energy below which the residual is rounding, not noise."""
CHANNEL_FLOOR = 1e-6
FRAMES_PER_CHANNEL = 6
FEWEST_CHANNELS = 4
WHITENING_FLOOR = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class SinusoidFit:
    """Lines by frequency. `covariance` is of (frequencies Hz, damping ratios), 2 modes square.

    `amplitudes` are of exp(λ (t - times[0])): a channel is the real part of their sum, in the channels' unit.
    """

    times: Float[np.ndarray, " frames"]
    frequencies: Float[np.ndarray, " modes"]
    damping_ratios: Float[np.ndarray, " modes"]
    covariance: Float[np.ndarray, "parameters parameters"]
    amplitudes: Complex[np.ndarray, "modes channels"]
    constant: Float[np.ndarray, " channels"]
    residuals: Float[np.ndarray, "frames channels"]
    noise: Float[np.ndarray, "channels channels"]

    @property
    def frequency_stds(self) -> Float[np.ndarray, " modes"]:
        """Standard deviations in Hz."""
        return np.sqrt(np.diag(self.covariance)[: len(self.frequencies)])

    @property
    def damping_stds(self) -> Float[np.ndarray, " modes"]:
        """Standard deviations of the damping ratios."""
        return np.sqrt(np.diag(self.covariance)[len(self.frequencies) :])

    def lag_one(self, kept: Bool[np.ndarray, " modes"]) -> float:
        """Correlation from frame to frame of what the `kept` lines leave; above 0.2 the intervals are optimistic.

        Weak lines must not be kept: where the clouds' errors drift, lines are found in them until nothing drifts.
        """
        lines = np.column_stack([self.frequencies, self.damping_ratios])
        columns = damped_columns(self.times, lines[~kept])[:, 1:]
        dropped = columns[:, ::2] @ self.amplitudes[~kept].real - columns[:, 1::2] @ self.amplitudes[~kept].imag
        residuals = _solve_linear(self.times, self.residuals + dropped, lines[kept])[1]
        white = residuals @ _whitener(_covariance(residuals, residuals, lines[kept]))
        return float((white[1:] * white[:-1]).sum() / max((white**2).sum(), 1e-300))


def useful_channels(scores: Float[np.ndarray, "frames rank"]) -> int:
    """How many leading scores a record of this length can carry: a sixth of its frames, none that is rounding.

    More channels cancel more of the noise that they share, but their covariance is learnt from the same frames:
    beyond a sixth the errors grow again, and the stated deviations do not follow.
    """
    sizes = np.linalg.norm(scores, axis=0)
    alive = int(np.count_nonzero(sizes > CHANNEL_FLOOR * max(sizes.max(initial=0.0), 1e-300)))
    return max(1, min(alive, max(FEWEST_CHANNELS, (len(scores) - 9) // FRAMES_PER_CHANNEL)))


def fit_sinusoids(
    times: Float[np.ndarray, " frames"],
    channels: Float[np.ndarray, "frames channels"],
    *,
    frame_rate: float,
    max_modes: int,
    rng: np.random.Generator,
    known: Float[np.ndarray, "modes 2"] | None = None,
) -> SinusoidFit:
    """All lines that stand out of the noise.

    Parameters
    ----------
    times
        Instants in seconds, increasing, any spacing.
    channels
        Scores in metres; linearly independent, at most a sixth of the frames (`useful_channels`).
    frame_rate
        Nominal rate in Hz: lines are searched up to 0.47 of it.
    max_modes
        At most this many lines.
    rng
        Draws the shuffles.
    known
        Lines of a shorter look at the same record: where the search starts, if they still stand.
    """
    span = times[-1] - times[0]
    low, high = max(1.0 / span, LOWEST_HZ), HIGHEST_SHARE * frame_rate
    wide = (high - low) * len(times) > WIDE
    search: Grid | Windows = (
        windows_of(times, frame_rate, low, high) if span > LONG_S or wide else candidate_grid(times, low, high)
    )
    lines = _still_standing(times, channels, known, search, frame_rate, rng)
    total = ((channels - channels.mean(axis=0)) ** 2).sum()
    while len(lines) < max_modes:
        residuals = _solve_linear(times, channels, lines)[1]
        if (residuals**2).sum() <= NOTHING_LEFT * total:
            break
        line = _find(times, residuals, lines, search, rng)
        if line is None:
            break
        grown = fit_lines(times, channels, np.vstack([lines, line]), frame_rate=frame_rate)
        if _split(grown, times):
            search = search.without(line[0], 1.0 / span)  # misfit of a line that is there already
            continue
        lines = grown
    return _summarise(times, channels, lines)


def _still_standing(
    times: np.ndarray,
    channels: np.ndarray,
    known: np.ndarray | None,
    search: Grid | Windows,
    frame_rate: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """The known lines refined, less the weakest ones that would not be found again."""
    lines = np.zeros((0, 2)) if known is None else known
    while len(lines):
        lines = fit_lines(times, channels, lines, frame_rate=frame_rate)
        solution = _solve_linear(times, channels, lines)[0][1:]
        weakest = int(np.argmin((solution**2).reshape(len(lines), -1).sum(axis=1)))
        others = np.delete(lines, weakest, axis=0)
        without = fit_lines(times, channels, others, frame_rate=frame_rate) if len(others) else others
        again = _find(times, _solve_linear(times, channels, without)[1], without, search, rng)
        near = again is not None and abs(again[0] - lines[weakest, 0]) <= 1.0 / (times[-1] - times[0])
        if near and not _split(lines, times):
            break
        lines = without
    return lines


def _find(
    times: np.ndarray, residuals: np.ndarray, lines: np.ndarray, search: Grid | Windows, rng: np.random.Generator
) -> np.ndarray | None:
    if isinstance(search, Grid):
        return find_line(times, residuals, lines, grid=search, rng=rng)
    return search.find(whitened(residuals), 1 - (2 * len(lines) + 1) / len(times), rng)


def fit_lines(
    times: Float[np.ndarray, " frames"],
    channels: Float[np.ndarray, "frames channels"],
    start: Float[np.ndarray, "modes 2"],
    *,
    frame_rate: float,
) -> Float[np.ndarray, "modes 2"]:
    """Joint fit of a given number of lines (frequency Hz, damping ratio) from `start`, covariance re-estimated."""
    span = times[-1] - times[0]
    bounds = Bounds(low=np.array([0.5 / span, DAMPING_RANGE[0]]), high=np.array([0.49 * frame_rate, DAMPING_RANGE[1]]))
    lines = start
    for _ in range(MOST_ROUNDS):
        before = lines
        residuals = _solve_linear(times, channels, lines)[1]
        whitener = _whitener(_covariance(residuals, channels, lines))
        lines, _ = refine(times, channels @ whitener, lines, bounds)
        if np.all(np.abs(lines - before) <= SETTLED):
            break
    return lines


def _solve_linear(times: np.ndarray, channels: np.ndarray, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    design = damped_columns(times, lines)
    solution, *_ = np.linalg.lstsq(design, channels, rcond=None)
    return solution, channels - design @ solution


def _covariance(residuals: np.ndarray, channels: np.ndarray, lines: np.ndarray) -> np.ndarray:
    freedom = max(len(residuals) - 2 * len(lines) - 1, 1)
    floor = WHITENING_FLOOR * np.var(channels, axis=0).sum() + 1e-300
    return np.asarray(residuals.T @ residuals / freedom + floor * np.eye(residuals.shape[1]))


def _whitener(noise: np.ndarray) -> np.ndarray:
    """W with (y @ W) of unit covariance."""
    return np.asarray(linalg.solve_triangular(np.linalg.cholesky(noise), np.eye(len(noise)), lower=True).T)


def _split(lines: np.ndarray, times: np.ndarray) -> bool:
    frequencies = np.sort(lines[:, 0])
    return bool(np.any(np.diff(frequencies) < CLOSEST / (times[-1] - times[0])))


def _summarise(times: np.ndarray, channels: np.ndarray, lines: np.ndarray) -> SinusoidFit:
    solution, residuals = _solve_linear(times, channels, lines)
    noise = _covariance(residuals, channels, lines)
    order = np.argsort(lines[:, 0], kind="stable")
    lines = lines[order]
    amplitudes = (solution[1::2] - 1j * solution[2::2])[order]
    return SinusoidFit(
        times=times,
        frequencies=lines[:, 0],
        damping_ratios=lines[:, 1],
        covariance=_parameter_covariance(times, channels @ _whitener(noise), lines),
        amplitudes=amplitudes,
        constant=solution[0],
        residuals=residuals,
        noise=noise,
    )


def _parameter_covariance(times: np.ndarray, white: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Inverse of the Gauss-Newton normal matrix, widened because the noise covariance was itself estimated.

    Learnt from `freedom` frames in p channels, it looks too small by freedom / (freedom - p), and the estimates that
    trust it are worse by the same factor.
    """
    if not len(lines):
        return np.zeros((0, 0))
    _, normal = refine(times, white, lines, None)
    freedom = len(times) - 2 * len(lines) - 1
    widening = freedom / max(freedom - white.shape[1], 1)
    return np.asarray(np.linalg.pinv(normal, hermitian=True) * widening**2)
