"""`preflight`: everything that can be said of a scan before it runs."""

import math
from collections.abc import Sequence
from typing import Literal

from nerfmodal.preflight.answer import Cost, Finding, Preflight, RecordLimits
from nerfmodal.preflight.expected import (
    ExpectedMode,
    Seen,
    excitation_of,
    limits_of,
    modes_of_spec,
    optics_of,
    seen_in,
)
from nerfmodal.preflight.findings import FEWEST_FRAMES, all_findings
from nerfmodal.preflight.forecast import forecast, what_it_resolves
from nerfmodal.preflight.work import Pace, cost_of
from nerfmodal.spec import ScanSpec, SimulationSource


def preflight(
    spec: ScanSpec,
    *,
    seen: Seen | None = None,
    expected: Sequence[ExpectedMode] = (),
    noise: float | None = None,
    noise_per_grain: float | None = None,
    pixels: int | None = None,
    pace: Pace | None = None,
) -> Preflight:
    """What this record can and cannot resolve, and what it will cost.

    Parameters
    ----------
    spec
        The scan; nothing it names is opened.
    seen
        What was found inside a capture or a record of clouds; a simulation says it itself.
    expected
        Modes that the structure is expected to have, beside those that a simulation imposes.
    noise
        Standard deviation of a modal coordinate in one frame, metres; by default what the grain gives.
    noise_per_grain
        The same in grains, from the rig's certificate.
    pixels
        In all views of a frame of a capture; a simulation says it itself.
    pace
        How fast these workers are; by default one core of the reference machine.
    """
    seen = seen_in(spec) or seen
    record = None if seen is None else limits_of(seen)
    optics = None if seen is None else optics_of(spec, seen, noise, noise_per_grain)
    excitation, modes = excitation_of(spec), modes_of_spec(spec, expected)
    level = optics.noise_m if optics is not None else noise
    told = tuple(forecast(mode, record, excitation, level) for mode in modes) if record and _holds_modes(record) else ()
    cost = None if seen is None else _cost(spec, seen, pixels, pace or Pace())
    findings = all_findings(spec, excitation, record, optics, modes, told, cost)
    return Preflight(
        verdict=_verdict(findings),
        excitation=excitation,
        record=record,
        optics=optics,
        modes=told,
        resolves=what_it_resolves(record, excitation) if record and _holds_modes(record) else (),
        cost=cost,
        findings=findings,
    )


def _cost(spec: ScanSpec, seen: Seen, pixels: int | None, pace: Pace) -> Cost | None:
    """None of a scan that is beyond all measure."""
    source = spec.source
    if isinstance(source, SimulationSource):
        pixels = source.rig.cameras * source.rig.width_px * source.rig.height_px
    try:
        cost = cost_of(spec, seen, pixels or 0, pace)
    except OverflowError:
        return None
    return cost if math.isfinite(cost.work_s) else None


def _holds_modes(record: RecordLimits) -> bool:
    return record.frames >= FEWEST_FRAMES


def _verdict(findings: Sequence[Finding]) -> Literal["ok", "warn", "refuse"]:
    worst = findings[0].severity if findings else "note"
    return "ok" if worst == "note" else worst
