"""Every number of a fleet as a long table: one row for each plant × scan × track × trait, ready for a mixed model.

Factors (treatment, genotype, replicate, block, position) and surroundings stand in every row, so that a line such as
``lmer(value ~ treatment * day + temperature_c + (1 | plant))`` needs no join.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from scanjobs.fleet.environment import COLUMNS as SURROUNDINGS
from scanjobs.fleet.environment import at_moments, series_of
from scanjobs.fleet.tables import Observation, Plant, Track
from scanjobs.fleet.tracks import name_of

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
    query = select(Plant).where(Plant.owner == extent.owner)
    if extent.study is not None:
        query = query.where(Plant.study == extent.study)
    if extent.plant is not None:
        query = query.where(Plant.id == extent.plant)
    return tuple(session.scalars(query.order_by(Plant.id)))


def long_rows(session: Session, extent: Extent) -> Iterator[dict[str, Any]]:
    """The table's rows, plant by plant, the oldest scan first; keys are `COLUMNS`."""
    for plant in plants_of(session, extent):
        yield from _rows_of(session, plant, extent)


def observed(extent: Extent) -> "Select[Observation, Track, Plant]":
    """Modes that belong to tracks, with track and plant, in a steady order."""
    query = (
        select(Observation, Track, Plant)
        .join(Track, Track.id == Observation.track_id)
        .join(Plant, Plant.key == Observation.plant_key)
        .where(Plant.owner == extent.owner)
    )
    if extent.study is not None:
        query = query.where(Plant.study == extent.study)
    if extent.plant is not None:
        query = query.where(Plant.id == extent.plant)
    if extent.since is not None:
        query = query.where(Observation.at >= extent.since)
    if extent.until is not None:
        query = query.where(Observation.at <= extent.until)
    return query.order_by(Plant.id, Observation.at, Observation.scan_id, Observation.organ, Observation.mode)


def count_observed(session: Session, extent: Extent) -> int:
    """How many rows `observed` has."""
    return session.scalars(select(func.count()).select_from(observed(extent).order_by(None).subquery())).one()


def value_of(trait: Trait, mode: Observation, track: Track) -> tuple[float | None, float | None]:
    """A trait and its standard deviation; None where it is not known."""
    if trait.name == "natural_frequency":
        return mode.frequency_hz, mode.frequency_std_hz
    if trait.name == "damping_ratio":
        return mode.damping_ratio, mode.damping_ratio_std
    if trait.name == "amplitude":
        return mode.amplitude_m, None
    if not track.reference_hz:
        return None, None
    std = None if mode.frequency_std_hz is None else mode.frequency_std_hz / track.reference_hz
    return mode.frequency_hz / track.reference_hz, std


def _rows_of(session: Session, plant: Plant, extent: Extent) -> Iterator[dict[str, Any]]:
    of_plant = Extent(owner=extent.owner, plant=plant.id, since=extent.since, until=extent.until)
    found = [(mode, track) for mode, track, _ in session.execute(observed(of_plant))]
    if not found:
        return
    at = np.array([mode.at for mode, _ in found])
    around = at_moments(series_of(session, plant), at)
    factors = {name: getattr(plant, name) for name in FACTORS} | {"plant": plant.id, "plant_name": plant.name}
    for k, (mode, track) in enumerate(found):
        place = {
            "scan": mode.scan_id,
            "at": datetime.fromtimestamp(mode.at, UTC).isoformat(),
            "days": round((mode.at - at[0]) / 86_400.0, 6),
            "track": track.id,
            "track_name": name_of(track),
            "organ": track.organ,
            "verdict": mode.verdict,
            "link": mode.link,
            **{name: _known(around, name, k) for name in SURROUNDINGS},
        }
        for trait in TRAITS:
            value, std = value_of(trait, mode, track)
            if value is not None:
                row = factors | place | {"trait": trait.name, "value": value, "std": std, "unit": trait.unit}
                yield {name: row[name] for name in COLUMNS}


def _known(around: dict[str, np.ndarray], name: str, k: int) -> float | None:
    column = around.get(name)
    return None if column is None or not np.isfinite(column[k]) else round(float(column[k]), 4)
