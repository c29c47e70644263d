"""What BrAPI 2.1 wants to read (https://brapi.org/specification): names are camelCase and pages count from 0."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from pydantic import BaseModel
from scanjobs.fleet.long_table import TRAITS, Trait, value_of
from scanjobs.fleet.tables import Observation, Plant, Track
from scanjobs.fleet.tracks import name_of

UNASSIGNED = "unassigned"
"""The study of plants that have none."""
Entity = dict[str, Any]


class Pagination(BaseModel):
    """Where a page lies."""

    currentPage: int
    pageSize: int
    totalCount: int
    totalPages: int


class Metadata(BaseModel):
    """Stands before every result."""

    datafiles: list[Entity] = []
    pagination: Pagination
    status: list[Entity] = []


class Listed(BaseModel):
    """The entities of a page."""

    data: list[Entity]


class BrapiPage(BaseModel):
    """A page of entities."""

    metadata: Metadata
    result: Listed


class BrapiSingle(BaseModel):
    """One result that is no list."""

    metadata: Metadata
    result: Entity


def page_of(items: Sequence[Entity], page: int, size: int, total: int) -> BrapiPage:
    """Entities that are a page already."""
    return BrapiPage(metadata=_metadata(page, size, total), result=Listed(data=list(items)))


def single_of(result: Entity) -> BrapiSingle:
    """What is no list."""
    return BrapiSingle(metadata=_metadata(0, 1, 1), result=result)


def trial_of(study: str | None) -> Entity:
    """A study's trial: one each."""
    name = study or UNASSIGNED
    return {"trialDbId": name, "trialName": name, "active": True}


def study_of(study: str | None, plants: int) -> Entity:
    """A study (MIAPPE: DM-17 'study name', DM-15 'experimental design' by block and replicate)."""
    name = study or UNASSIGNED
    return {
        "studyDbId": name,
        "studyName": name,
        "trialDbId": name,
        "trialName": name,
        "active": True,
        "studyType": "phenotyping study",
        "observationUnitsDescription": "one potted plant",
        "additionalInfo": {"plants": plants},
    }


def unit_of(plant: Plant) -> Entity:
    """A plant as an observation unit (MIAPPE: DM-70 … DM-74)."""
    levels = [("rep", plant.replicate), ("block", plant.block)]
    return {
        "observationUnitDbId": plant.id,
        "observationUnitName": plant.name,
        "studyDbId": plant.study or UNASSIGNED,
        "trialDbId": plant.study or UNASSIGNED,
        "germplasmName": plant.genotype or plant.species,
        "treatments": [{"factor": "treatment", "modality": plant.treatment}] if plant.treatment else [],
        "observationUnitPosition": {
            "entryType": "TEST",
            "positionCoordinateX": plant.position,
            "positionCoordinateXType": "GRID_COL" if plant.position else None,
            "observationLevel": {"levelName": "plant", "levelCode": plant.id},
            "observationLevelRelationships": [
                {"levelName": name, "levelCode": code} for name, code in levels if code is not None
            ],
        },
        "additionalInfo": {"species": plant.species or "", "tags": " ".join(plant.tags)},
    }


def variable_of(trait: Trait) -> Entity:
    """A trait as an observation variable: trait, method and scale."""
    return {
        "observationVariableDbId": trait.name,
        "observationVariableName": trait.name,
        "trait": {
            "traitDbId": trait.name,
            "traitName": trait.what,
            "traitClass": "biomechanics",
            "entity": "plant organ",
        },
        "method": {"methodDbId": trait.method, "methodName": trait.method, "methodClass": "Computation"},
        "scale": {"scaleDbId": trait.unit, "scaleName": trait.unit, "dataType": "Numerical", "units": trait.unit},
    }


def observation_of(trait: Trait, mode: Observation, track: Track, plant: Plant) -> Entity:
    """A trait of a track at a scan; `value` is text, as BrAPI has it."""
    value, std = value_of(trait, mode, track)
    return {
        "observationDbId": f"{mode.scan_id}:{mode.organ}:{mode.mode}:{trait.name}",
        "observationUnitDbId": plant.id,
        "observationUnitName": plant.name,
        "observationVariableDbId": trait.name,
        "observationVariableName": trait.name,
        "studyDbId": plant.study or UNASSIGNED,
        "observationTimeStamp": datetime.fromtimestamp(mode.at, UTC).isoformat(),
        "value": None if value is None else repr(value),
        "additionalInfo": {
            "scan": mode.scan_id,
            "track": track.id,
            "trackName": name_of(track),
            "organ": track.organ,
            "std": None if std is None else repr(std),
            "verdict": mode.verdict,
        },
    }


def traits_called(name: str | None) -> tuple[Trait, ...]:
    """All traits, or the one of this name."""
    return tuple(trait for trait in TRAITS if name is None or trait.name == name)


def _metadata(page: int, size: int, total: int) -> Metadata:
    pages = Pagination(currentPage=page, pageSize=size, totalCount=total, totalPages=math.ceil(total / size))
    return Metadata(pagination=pages)
