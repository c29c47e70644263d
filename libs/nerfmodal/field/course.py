"""How a training goes: its loss, its speed, and when to give up or to stop.

The loss of a batch is noisy; what is judged and told is its running mean.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import TrainingDiverged

Told = Callable[[int, int, str], None]
"""Called with (iterations done, of, what to say)."""
MEMORY = 0.9
WARM_UP = 50
"""Iterations before a loss is good enough to compare later ones with."""
APPEARED = 0.01
"""Share of the rays that may begin or cease to meet a surface that rests."""
WORSE = 10.0
"""A loss so many times its best is not coming back."""


class Course:
    """Follows one training of `total` iterations."""

    def __init__(self, total: int, told: Told) -> None:
        self.total, self.done, self.loss = total, 0, np.nan
        self._told = told
        self._best = np.inf
        self._rays = 0
        self._began = perf_counter()

    def go_on(self, done: int, loss: float) -> None:
        """Begin where an earlier training was stopped."""
        self.done, self.loss = done, loss

    def turn(self) -> None:
        """What follows differs from what went before: its loss is no longer compared with the best."""
        self._best = np.inf

    def step(self, loss: float, rays: int) -> None:
        """One more iteration of so many rays, with this mean squared error.

        Raises
        ------
        TrainingDiverged
            When the loss is no number, or has become much worse than it was.
        """
        if not np.isfinite(loss):
            raise TrainingDiverged(f"the loss became {loss} at iteration {self.done}.")
        self.loss = loss if np.isnan(self.loss) else MEMORY * self.loss + (1 - MEMORY) * loss
        self.done += 1
        self._rays += rays
        if self.done > WARM_UP:
            self._best = min(self._best, self.loss)
            if self.loss > WORSE * self._best:
                raise TrainingDiverged(
                    f"the loss rose from {self._best:.3g} to {self.loss:.3g} at iteration {self.done}."
                )
        self._told(self.done, self.total, self.message)

    @property
    def message(self) -> str:
        """Loss, PSNR and speed in words."""
        rate = self._rays / max(perf_counter() - self._began, 1e-6)
        return f"loss {self.loss:.2e}, PSNR {psnr(self.loss):.1f} dB, {rate / 1e3:.3g}k rays/s"


def psnr(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio, dB, of colours in [0, 1]."""
    return float(-10.0 * np.log10(max(mean_squared_error, 1e-12)))


class Settling:
    """Tells when a surface has stopped moving.

    Parameters
    ----------
    look
        Gives the distances (rays,) in metres at which some rays meet the surface now; 0 is a ray that meets none.
    limit
        Root-mean-square movement between two looks, metres, below which the surface rests.
    """

    def __init__(self, look: Callable[[], Float[np.ndarray, " rays"]], limit: float) -> None:
        self._look = look
        self._limit = limit
        self._before: Float[np.ndarray, " rays"] | None = None

    def rests(self) -> bool:
        """Look again: do the rays meet the surface where they met it before?"""
        before, now = self._before, self._look()
        self._before = now
        if before is None:
            return False
        both = (now > 0) & (before > 0)
        appeared = np.count_nonzero((now > 0) != (before > 0))
        if not both.any() or appeared > APPEARED * len(now):
            return False
        return bool(np.sqrt(np.mean((now[both] - before[both]) ** 2)) < self._limit)
