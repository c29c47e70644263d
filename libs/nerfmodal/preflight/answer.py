"""What preflight answers: one frozen tree that is at once the JSON of the API and of the command line.

SI units; a unit suffix stands on every key because types are lost in JSON. What is not known is null.
"""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["refuse", "warn", "note"]
Excitation = Literal["free_decay", "harmonic", "ambient"]
Chance = Literal["likely", "uncertain", "unlikely", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that the user should know: a stable code, the key it is about (JSON pointer), and what to change."""

    severity: Severity
    code: str
    pointer: str
    message: str
    hint: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordLimits:
    """What the record's length and rate alone allow.

    A mode above `highest_hz` (0.45 frame rates) cannot be told from its alias; one below `lowest_hz` has fewer than two
    periods in the record.
    """

    frames: int
    frame_rate_hz: float
    duration_s: float
    nyquist_hz: float
    highest_hz: float
    lowest_hz: float
    bin_width_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """How finely the scan sees: `footprint_m` is the side of a pixel where the structure is.

    `grain_m` is the larger of the footprint and the field's finest voxel; `noise_m` is the standard deviation of a
    modal coordinate in one frame, and `noise_basis` says where it comes from.
    """

    cameras: int
    distance_m: float
    footprint_m: float
    grain_m: float
    noise_m: float
    noise_basis: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeForecast:
    """How well one mode will be read: expected standard deviations, one each side of the truth.

    `amplitude_m` is the mode's envelope at the first frame (of wind: its standard deviation). `strength` is the root of
    its energy over the record in units of the noise; from 14 on a mode is nearly always found. `organ` is null for a
    line that nobody asked for and that shows what the record can do; deviations are null where the record says nothing.
    """

    organ: str | None
    shape: str | None
    frequency_hz: float
    damping_ratio: float
    amplitude_m: float | None
    amplitude_to_noise: float
    periods: float
    frequency_std_hz: float | None
    damping_std: float | None
    strength: float
    found: Chance


@dataclass(frozen=True, slots=True, kw_only=True)
class StepCost:
    """Steps of one kind: how many, and how long one takes. `basis` says whether that was measured here."""

    step: str
    count: int
    seconds_each: float
    basis: Literal["history", "reference"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What the scan takes: seconds of work in sum, and seconds until it is done on `slots` workers."""

    steps: tuple[StepCost, ...]
    work_s: float
    elapsed_s: float
    slots: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Preflight:
    """The whole answer. `verdict` is that of the gravest finding; parts that cannot be known yet are null."""

    verdict: Literal["ok", "warn", "refuse"]
    excitation: Excitation
    record: RecordLimits | None
    optics: Optics | None
    modes: tuple[ModeForecast, ...]
    resolves: tuple[ModeForecast, ...]
    cost: Cost | None
    findings: tuple[Finding, ...]
