"""Where a chart signals, from how rarely it may do so by chance: average run lengths (ARL), in scans.

EWMA: the Markov chain of Brook & Evans (1972), as Lucas & Saccucci (1990) apply it. CUSUM: Siegmund's (1985)
approximation. T²: Hotelling's with an estimated covariance, two scans in a row beyond the limit.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.optimize import brentq
from scipy.special import fdtri, ndtr

STATES: Final = 121
"""Of the Markov chain, over both sides; the ARL changes by less than a percent with more."""
SIEGMUND: Final = 1.166
"""The overshoot of a random walk of standard normals over two barriers."""
LONGEST: Final = 1e9


def ewma_run_length(limit: float, weight: float) -> float:
    """ARL of a two-sided EWMA of standard normals with this weight, where `limit` is in its standard deviations."""
    reach = limit * math.sqrt(weight / (2.0 - weight))
    step = 2.0 * reach / STATES
    centres = -reach + step * (np.arange(STATES) + 0.5)
    kept = (1.0 - weight) * centres[:, None]
    upper = ndtr((centres + step / 2.0 - kept) / weight)
    lower = ndtr((centres - step / 2.0 - kept) / weight)
    lengths = np.linalg.solve(np.eye(STATES) - (upper - lower), np.ones(STATES))
    return float(min(max(lengths[STATES // 2], 1.0), LONGEST))


@lru_cache(maxsize=256)
def ewma_limit(run_length: float, weight: float) -> float:
    """The limit, in standard deviations of the EWMA, whose ARL is `run_length`."""
    target = math.log(run_length)
    return float(brentq(lambda limit: math.log(ewma_run_length(limit, weight)) - target, 0.2, 6.0, xtol=1e-4))


def cusum_run_length(limit: float, slack: float) -> float:
    """ARL of a two-sided CUSUM of standard normals: Siegmund 1985, eq 2.64, halved for its two sides."""
    barrier = limit + SIEGMUND
    exponent = 2.0 * slack * barrier
    if exponent > math.log(LONGEST):
        return LONGEST
    return (math.exp(exponent) - exponent - 1.0) / (2.0 * slack**2) / 2.0


@lru_cache(maxsize=256)
def cusum_limit(run_length: float, slack: float) -> float:
    """The decision interval whose ARL is `run_length`."""
    return float(brentq(lambda limit: cusum_run_length(limit, slack) - run_length, 0.0, 40.0, xtol=1e-6))


def twice_in_a_row(run_length: float, outliers: float = 0.0) -> float:
    """Probability a per scan such that two scans in a row beyond it come every `run_length` scans.

    Where a share of the scans are outliers, beyond any limit, one of them and an unlucky neighbour are two in a row as
    well: a² + 2 outliers a = 1 / run_length.
    """
    return -outliers + math.sqrt(outliers**2 + 1.0 / run_length)


def t2_limit(probability: float, variables: int, learned: int) -> float:
    """Hotelling's T² of a new scan that is exceeded with this probability; covariance learned from `learned` scans."""
    freedom = learned - variables
    if freedom < 1:
        return float("inf")
    scale = variables * (learned - 1) * (learned + 1) / (learned * freedom)
    return float(scale * fdtri(variables, freedom, 1.0 - probability))
