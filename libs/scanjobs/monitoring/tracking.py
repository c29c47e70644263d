"""Modes of successive scans joined into tracks: a Kalman filter per track, an assignment per scan.

ln f of a track is a random walk with `Rules.drift` per square root of a day; a scan measures it with the standard
deviation of its estimate. Tracks and modes of a scan are paired at once so that the sum of costs is the smallest
(Munkres by `scipy.optimize.linear_sum_assignment`), the cost being minus twice the log likelihood of frequency and
shape; a mode may be a birth, a track may be missing (Blackman & Popoli 1999, Design and Analysis of Modern Tracking
Systems, ch. 6). What is behind the gate is no match. A link that has an alternative nearly as likely, or that jumps
further than a random walk would, is doubtful and says so: no track changes modes silently.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from scanjobs.monitoring.shapes import mac

DAY_S: Final = 24 * 3600.0
FORBIDDEN: Final = 1e9
Link = Literal["born", "sure", "doubtful", "manual"]
Key = tuple[str, str, int]
"""Scan, organ, number of the mode within the organ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A mode of one scan. `may_found` is False for what is too doubtful to begin a track."""

    key: Key
    at: float
    frequency: float
    std: float | None
    shape: bytes | None = None
    may_found: bool = True
    before: str | None = None
    """The track it belonged to when tracks were last computed: identities are kept."""

    @property
    def organ(self) -> str:
        """The organ it is a mode of."""
        return self.key[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """What a track may do. Frequencies are relative (ln f)."""

    drift: float = 0.02
    """Standard deviation of the random walk over a day."""
    scatter: float = 0.004
    """Of a frequency from scan to scan beyond its own standard deviation: another gust, another exposure."""
    gate: float = 16.0
    """Largest squared distance in standard deviations of a match (4 sigma)."""
    sure: float = 9.0
    """Above this squared distance a match is doubtful."""
    margin: float = 6.0
    """A link whose best alternative costs less than this more is doubtful: a likelihood ratio of exp(3) = 20."""
    mac_least: float = 0.6
    """Shapes that agree less are two modes."""
    mac_std: float = 0.08
    """Of 1 - MAC between scans of one mode."""
    patience: int = 5
    """Scans of its organ that a track may be missing from before it has ended."""
    widest: float = 0.25
    """No match over a larger change of ln f, however long ago."""


@dataclass(slots=True)
class Course:
    """A track under way: its filter and what it went through. `label` is its identity."""

    organ: str
    log_frequency: float
    variance: float
    at: float
    shape: bytes | None
    label: str | None = None
    keys: list[Key] = field(default_factory=list)
    missed: int = 0
    missed_in_all: int = 0
    alive: bool = True


@dataclass(frozen=True, slots=True)
class Placed:
    """Where a mode belongs: to the course of this number (None: to none), by which link, with which shape agreement."""

    course: int | None
    link: Link | None = None
    mac: float | None = None


@dataclass(frozen=True, slots=True)
class Tracks:
    """All courses of a plant, and the place of every mode."""

    courses: tuple[Course, ...]
    placed: Mapping[Key, Placed]


def track(scans: Sequence[Sequence[Seen]], pins: Mapping[Key, str | None], rules: Rules | None = None) -> Tracks:
    """Join the modes of a plant's scans, oldest first.

    Parameters
    ----------
    scans : the modes of each scan; a scan that found none is empty.
    pins : what a person decided, mode → label of a track, or None for no track. Goes before everything.
    """
    run = _Run(pins, rules or Rules())
    for modes in scans:
        run.take(modes)
    return Tracks(tuple(run.courses), run.placed)


class _Run:
    """The state of `track` between two scans."""

    def __init__(self, pins: Mapping[Key, str | None], rules: Rules) -> None:
        self.courses: list[Course] = []
        self.placed: dict[Key, Placed] = {}
        self._pins = pins
        self._rules = rules

    def take(self, modes: Sequence[Seen]) -> None:
        """Pair the modes of the next scan."""
        by_hand = [mode for mode in modes if mode.key in self._pins]
        free = [mode for mode in modes if mode.key not in self._pins]
        seen = {number for mode in by_hand if (number := self._place_by_hand(mode)) is not None}
        for organ in dict.fromkeys(mode.organ for mode in free):
            seen |= self._assign([mode for mode in free if mode.organ == organ], organ, seen)
        for organ in {mode.organ for mode in modes}:
            self._miss(organ, seen)

    def _place_by_hand(self, mode: Seen) -> int | None:
        label = self._pins[mode.key]
        if label is None:
            self.placed[mode.key] = Placed(None, "manual")
            return None
        number = next((k for k, course in enumerate(self.courses) if course.label == label), None)
        if number is None:
            self._end_rival(mode)
            return self._found(mode, label, "manual")
        self._extend(number, mode, "manual")
        return number

    def _end_rival(self, mode: Seen) -> None:
        """A person has said that this mode is not of the track that it would go to: that one ends here."""
        costs = [(self._cost(course, mode), k) for k, course in enumerate(self.courses) if self._is_open(k, mode.organ)]
        if costs and min(costs)[0] < self._rules.gate:
            self.courses[min(costs)[1]].alive = False

    def _is_open(self, number: int, organ: str) -> bool:
        return self.courses[number].alive and self.courses[number].organ == organ

    def _assign(self, modes: Sequence[Seen], organ: str, taken: set[int]) -> set[int]:
        open_ones = [k for k in range(len(self.courses)) if self._is_open(k, organ) and k not in taken]
        costs = np.array([[self._cost(self.courses[k], mode) for mode in modes] for k in open_ones])
        costs = costs.reshape(len(open_ones), len(modes))
        pairs, total = _pair(costs, self._rules.gate)
        seen: set[int] = set()
        for row, column in pairs:
            number, mode = open_ones[row], modes[column]
            self._extend(number, mode, self._judge(costs, row, column, total))
            seen.add(number)
        paired = {column for _, column in pairs}
        for column, mode in enumerate(modes):
            if column not in paired:
                seen |= self._begin(mode)
        return seen

    def _begin(self, mode: Seen) -> set[int]:
        if not mode.may_found:
            self.placed[mode.key] = Placed(None)
            return set()
        return {self._found(mode, None, "born")}

    def _cost(self, course: Course, mode: Seen) -> float:
        """Squared distance in standard deviations, of frequency and of shape."""
        rules = self._rules
        step = math.log(mode.frequency) - course.log_frequency
        agreement = mac(course.shape, mode.shape)
        if abs(step) > rules.widest or (agreement is not None and agreement < rules.mac_least):
            return FORBIDDEN
        distance = step**2 / (self._spread(course, mode) + _measured(mode, rules))
        unlike = 0.0 if agreement is None else ((1.0 - agreement) / rules.mac_std) ** 2
        cost = distance + unlike
        return cost if cost <= rules.gate else FORBIDDEN

    def _spread(self, course: Course, mode: Seen) -> float:
        """Variance of the prediction of ln f: what was known, and the walk since."""
        days = max(mode.at - course.at, 0.0) / DAY_S
        return course.variance + self._rules.drift**2 * days

    def _judge(self, costs: np.ndarray, row: int, column: int, total: float) -> Link:
        """Doubtful: far from what was predicted, or another pairing of tracks and modes is nearly as good."""
        if costs[row, column] > self._rules.sure:
            return "doubtful"
        rivals = (costs[row] < FORBIDDEN).sum() + (costs[:, column] < FORBIDDEN).sum() - 2
        if rivals <= 0:
            return "sure"
        without = costs.copy()
        without[row, column] = FORBIDDEN
        _, other = _pair(without, self._rules.gate)
        return "doubtful" if other - total < self._rules.margin else "sure"

    def _extend(self, number: int, mode: Seen, link: Link) -> None:
        course, measured = self.courses[number], _measured(mode, self._rules)
        spread = self._spread(course, mode)
        gain = spread / (spread + measured)
        self.placed[mode.key] = Placed(number, link, mac(course.shape, mode.shape))
        course.log_frequency += gain * (math.log(mode.frequency) - course.log_frequency)
        course.variance = (1.0 - gain) * spread
        course.at = max(course.at, mode.at)
        course.shape = mode.shape or course.shape
        course.keys.append(mode.key)
        course.missed, course.alive = 0, True
        if course.label is None:
            course.label = self._inherited(mode)

    def _found(self, mode: Seen, label: str | None, link: Link) -> int:
        course = Course(
            organ=mode.organ,
            log_frequency=math.log(mode.frequency),
            variance=_measured(mode, self._rules),
            at=mode.at,
            shape=mode.shape,
            label=label or self._inherited(mode),
            keys=[mode.key],
        )
        self.courses.append(course)
        self.placed[mode.key] = Placed(len(self.courses) - 1, link)
        return len(self.courses) - 1

    def _inherited(self, mode: Seen) -> str | None:
        """The identity that the mode's track had before, if no other course has it."""
        used = {course.label for course in self.courses}
        return mode.before if mode.before not in used else None

    def _miss(self, organ: str, seen: set[int]) -> None:
        for number, course in enumerate(self.courses):
            if number not in seen and self._is_open(number, organ):
                course.missed += 1
                course.missed_in_all += 1
                course.alive = course.missed <= self._rules.patience


def _measured(mode: Seen, rules: Rules) -> float:
    """Variance of a measured ln f."""
    return rules.scatter**2 + ((mode.std or 0.0) / mode.frequency) ** 2


def _pair(costs: np.ndarray, gate: float) -> tuple[list[tuple[int, int]], float]:
    """Pairs of rows and columns of the least total cost, where leaving a pair apart costs `gate`; and that total."""
    rows, columns = costs.shape
    if not rows or not columns:
        return [], 0.0
    square = np.full((rows + columns, rows + columns), FORBIDDEN)
    square[:rows, :columns] = costs
    square[np.arange(rows), columns + np.arange(rows)] = gate / 2  # the track is missing from this scan
    square[rows + np.arange(columns), np.arange(columns)] = gate / 2  # the mode is a birth
    square[rows:, columns:] = 0.0
    chosen = linear_sum_assignment(square)
    pairs = [(int(r), int(c)) for r, c in zip(*chosen, strict=True) if r < rows and c < columns]
    return [pair for pair in pairs if costs[pair] < FORBIDDEN], float(square[chosen].sum())
