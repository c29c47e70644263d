"""What the steps of a scan cost, from the durations of past ones: pure functions of numbers that the caller gives.

A step's work is counted in units (rays, samples) that grow with its cost; past steps give seconds for a unit, and the
median over past scans is the pace. Steps of which nothing is known take the pace of a reference machine.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Literal

from nerfmodal.preflight.answer import Cost, StepCost
from nerfmodal.preflight.expected import Seen
from nerfmodal.spec import CloudsSource, ScanSpec, SimulationSource

RENDER, READ, TRAIN, EXTRACT, IDENTIFY = "frame.render", "frame.read", "frame.train", "frame.extract", "scan.identify"
BEFORE_A_RENDER = 60_000
"""Rays that a view costs before its first: reading the scene."""
REFERENCE: Mapping[str, float] = {
    "frame.render blender": 8.3e-7,
    "frame.render preview": 5.3e-7,
    "frame.read capture": 1e-7,
    "frame.train grid": 7.9e-6,
    "frame.train mlp": 2e-2,
    "frame.extract grid": 4.9e-7,
    "frame.extract mlp": 8e-3,
    "scan.identify any": 3e-6,
}
"""Seconds for a unit on one core without GPU: processor time measured on the palm (24 views of 224 × 320); of the
paper's network by counting its operations at 50 thousand million a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PastStep:
    """The mean duration of a past scan's steps of one kind, and the units of work in one of them."""

    step: str
    variant: str
    seconds: float
    units: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """Seconds for a unit of work by step and variant (`frame.render blender`), and steps computed at the same time."""

    seconds_per_unit: Mapping[str, float] = field(default_factory=dict)
    slots: int = 1


def pace_of(history: Iterable[PastStep], slots: int) -> Pace:
    """The median pace of past steps; what took no time or did no work says nothing."""
    rates: dict[str, list[float]] = {}
    for past in history:
        if past.seconds > 0 and past.units > 0:
            rates.setdefault(f"{past.step} {past.variant}", []).append(past.seconds / past.units)
    return Pace(seconds_per_unit={key: median(values) for key, values in rates.items()}, slots=max(slots, 1))


def variant_of(step: str, spec: ScanSpec) -> str:
    """What makes steps of one kind differ beyond their size: the renderer, or the field."""
    if step == RENDER and isinstance(spec.source, SimulationSource):
        return spec.source.renderer
    if step in (TRAIN, EXTRACT):
        return spec.reconstruction.field
    return "capture" if step == READ else "any"


def units_of(step: str, spec: ScanSpec, seen: Seen, pixels: int) -> float:
    """Work in one step of this kind: rays to render, rays to train on, rays to look along, points to fit.

    `pixels` is the number in all views of a frame.
    """
    samples = spec.source.samples if isinstance(spec.source, SimulationSource) else 1
    work: Mapping[str, float] = {
        RENDER: pixels * samples + BEFORE_A_RENDER * (seen.cameras or 0),
        READ: pixels,
        TRAIN: spec.reconstruction.fine_tune_iterations * spec.reconstruction.rays_per_batch,
        EXTRACT: pixels,
        IDENTIFY: seen.frames * spec.reconstruction.points,
    }
    return float(work[step])


def cost_of(spec: ScanSpec, seen: Seen, pixels: int, pace: Pace) -> Cost:
    """What a scan costs at this pace: frame 0 is trained alone first, the frames side by side, the modes at the end."""
    clouds = isinstance(spec.source, CloudsSource)
    make = RENDER if isinstance(spec.source, SimulationSource) else READ
    kinds = [] if clouds else [(make, seen.frames), (TRAIN, seen.frames), (EXTRACT, seen.frames)]
    steps = [_step_cost(step, count, units_of(step, spec, seen, pixels), spec, pace) for step, count in kinds]
    last = _step_cost(IDENTIFY, 1, units_of(IDENTIFY, spec, seen, pixels), spec, pace)
    first = 0.0
    if not clouds:
        ratio = spec.reconstruction.iterations / spec.reconstruction.fine_tune_iterations
        first = steps[0].seconds_each + ratio * steps[1].seconds_each
    side_by_side = sum(step.count * step.seconds_each for step in steps)
    slots = min(pace.slots, seen.frames)
    return Cost(
        steps=(*steps, last),
        work_s=round(first + side_by_side + last.seconds_each, 1),
        elapsed_s=round(first + side_by_side / max(slots, 1) + last.seconds_each, 1),
        slots=pace.slots,
    )


def _step_cost(step: str, count: int, units: float, spec: ScanSpec, pace: Pace) -> StepCost:
    key = f"{step} {variant_of(step, spec)}"
    known = pace.seconds_per_unit.get(key)
    basis: Literal["history", "reference"] = "reference" if known is None else "history"
    rate = REFERENCE[key] if known is None else known
    return StepCost(step=step, count=count, seconds_each=round(rate * units, 3), basis=basis)
