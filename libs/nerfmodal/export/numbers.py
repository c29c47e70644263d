"""Numbers as they are written: a value with the digits that its standard deviation allows."""

import numpy as np

NORMAL_95 = 1.96


def measured(value: float | None, std: float | None, scale: float = 1.0) -> str:
    """Value ± standard deviation, both to the second digit of the latter; a dash for what is not known."""
    if value is None:
        return "–"
    if not std:
        return f"{scale * value:.4g}"
    decimals = _decimals(scale * std)
    return f"{scale * value:.{decimals}f} ± {scale * std:.{decimals}f}"


def interval(value: float | None, std: float | None, scale: float = 1.0) -> str:
    """The 95 % interval of a normal error, from … to …; a dash where the deviation is not known."""
    if value is None or not std:
        return "–"
    decimals = _decimals(scale * std)
    low, high = scale * (value - NORMAL_95 * std), scale * (value + NORMAL_95 * std)
    return f"{low:.{decimals}f} … {high:.{decimals}f}"


def share(value: float | None, digits: int = 3) -> str:
    """A number between 0 and 1, or a dash."""
    return "–" if value is None else f"{value:.{digits}f}"


def _decimals(std: float) -> int:
    """Places after the point up to the second digit of a deviation."""
    return int(np.clip(1 - np.floor(np.log10(std)), 0, 9))
