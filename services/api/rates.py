"""How often somebody may ask: a bucket that fills steadily and is emptied by requests (token bucket).

Kept in this process: with several API processes each grants the rate by itself.
"""

import time
from collections import OrderedDict
from collections.abc import Callable

BURST_S = 10.0
"""A bucket holds what is granted in this many seconds."""
HIGHEST_NAMES = 10_000


class Rates:
    """Buckets by name; the ones used longest ago are forgotten, which only fills them."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_s(self, name: str, per_minute: int) -> float:
        """Take one from the bucket: 0, or the seconds until there will be one (nothing is taken then)."""
        now, rate = self._clock(), per_minute / 60.0
        most = max(1.0, rate * BURST_S)
        level, at = self._buckets.pop(name, (most, now))
        level = min(most, level + (now - at) * rate)
        granted = level >= 1.0
        self._buckets[name] = (level - 1.0 if granted else level, now)
        if len(self._buckets) > HIGHEST_NAMES:
            self._buckets.popitem(last=False)
        return 0.0 if granted else (1.0 - level) / rate
