"""Every number of a fleet as a long table: one row for each plant × scan × track × trait, ready for a mixed model.

Factors (treatment, genotype, replicate, block, position) and surroundings stand in every row, so that a line such as
``lmer(value ~ treatment * day + temperature_c + (1 | plant))`` needs no join.
"""

from dataclasses import dataclass
from typing import Final

from sqlalchemy import ColumnElement, Select, func, select
from sqlalchemy.orm import Session

from scanjobs.fleet.environment import COLUMNS as SURROUNDINGS
from scanjobs.fleet.tables import Observation, Plant, Track

FACTORS: Final = ("study", "treatment", "species", "genotype", "replicate", "block", "position")
COLUMNS: Final = (
    *("plant", "plant_name", *FACTORS, "scan", "at", "days", "track", "track_name", "organ"),
    *("trait", "value", "std", "unit", "verdict", "link", *SURROUNDINGS),
)
NUMBERS: Final = frozenset({"days", "value", "std", *SURROUNDINGS})


@dataclass(frozen=True, slots=True)
class Trait:
    """What is measured of a track at a scan."""

    name: str
    unit: str
    what: str
    method: str


TRAITS: Final = (
    Trait("natural_frequency", "Hz", "Undamped natural frequency of the mode", "free decay or wind, from point clouds"),
    Trait("damping_ratio", "1", "Damping ratio of the mode, 0 to 1", "free decay or wind, from point clouds"),
    Trait("frequency_ratio", "1", "Natural frequency relative to the plant's own reference scans", "f / f0"),
    Trait("amplitude", "m", "Largest displacement anywhere on the organ", "modal coordinate times shape"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Which rows: of an owner, of one study or plant, between two moments (s)."""

    owner: str
    study: str | None = None
    plant: str | None = None
    since: float | None = None
    until: float | None = None


def plants_of(session: Session, extent: Extent) -> tuple[Plant, ...]:
    """The plants of an extent, by id."""
    return tuple(session.scalars(select(Plant).where(*plants_in(extent)).order_by(Plant.id)))


def plants_in(extent: Extent) -> list[ColumnElement[bool]]:
    """What holds of the plants of an extent."""
    said = [Plant.owner == extent.owner]
    if extent.study is not None:
        said.append(Plant.study == extent.study)
    return said if extent.plant is None else [*said, Plant.id == extent.plant]


def modes_in(extent: Extent) -> list[ColumnElement[bool]]:
    """What holds of modes between the moments of an extent."""
    after = [] if extent.since is None else [Observation.at >= extent.since]
    return after if extent.until is None else [*after, Observation.at <= extent.until]


def observed(extent: Extent) -> "Select[Observation, Track, Plant]":
    """Modes that belong to tracks, with track and plant, in a steady order."""
    return (
        select(Observation, Track, Plant)
        .join(Track, Track.id == Observation.track_id)
        .join(Plant, Plant.key == Observation.plant_key)
        .where(*plants_in(extent), *modes_in(extent))
        .order_by(Plant.id, Observation.at, Observation.scan_id, Observation.organ, Observation.mode)
    )


def count_observed(session: Session, extent: Extent) -> int:
    """How many rows `observed` has."""
    return session.scalars(select(func.count()).select_from(observed(extent).order_by(None).subquery())).one()


def value_of(trait: Trait, mode: Observation, track: Track) -> tuple[float | None, float | None]:
    """A trait and its standard deviation; None where it is not known."""
    found = values_of_traits(
        (mode.frequency_hz, mode.frequency_std_hz),
        (mode.damping_ratio, mode.damping_ratio_std),
        mode.amplitude_m,
        track.reference_hz,
    )
    return found[TRAITS.index(trait)]


def values_of_traits(
    frequency: tuple[float, float | None],
    damping: tuple[float | None, float | None],
    amplitude_m: float | None,
    reference_hz: float | None,
) -> tuple[tuple[float | None, float | None], ...]:
    """What a mode says of each of `TRAITS`, with its standard deviation; None where it is not known."""
    ratio: tuple[float | None, float | None] = (None, None)
    if reference_hz:
        ratio = (frequency[0] / reference_hz, None if frequency[1] is None else frequency[1] / reference_hz)
    return frequency, damping, ratio, (amplitude_m, None)
