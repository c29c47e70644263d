"""A read façade of the Breeding API 2.1: a program that reads field trials reads a fleet as well.

A study of plants is a BrAPI study with a trial of its own, a plant an observation unit, a trait of a mode an
observation variable; `docs/howto/fleet.md` has the mapping to MIAPPE.
"""

from typing import Annotated

from fastapi import APIRouter, Query
from scanjobs.fleet.long_table import TRAITS, Extent, count_observed, observed
from scanjobs.fleet.plants import Filters, Order, count_by, count_plants, list_plants
from scanjobs.fleet.tables import Plant

from services.api.dependencies import Owner, TheParts
from services.api.routes.info import package_version
from services.api.routes.plants import PlantWord
from services.api.schemas_brapi import (
    UNASSIGNED,
    BrapiPage,
    BrapiSingle,
    observation_of,
    page_of,
    single_of,
    study_of,
    traits_called,
    trial_of,
    unit_of,
    variable_of,
)
from services.api.schemas_plants import Label

SERVICES = ("serverinfo", "commoncropnames", "trials", "studies", "observationunits", "variables", "observations")
Page = Annotated[int, Query(ge=0, le=10**6)]
Size = Annotated[int, Query(ge=1, le=2000, alias="pageSize")]
Study = Annotated[Label | None, Query(alias="studyDbId")]
Unit = Annotated[PlantWord | None, Query(alias="observationUnitDbId")]
Variable = Annotated[Label | None, Query(alias="observationVariableDbId")]
router = APIRouter(prefix="/brapi/v2", tags=["brapi"])


@router.get("/serverinfo")
def server_info(owner: Owner) -> BrapiSingle:
    """Which calls there are."""
    calls = [
        {"service": name, "methods": ["GET"], "versions": ["2.1"], "contentTypes": ["application/json"]}
        for name in SERVICES
    ]
    about = {
        "serverName": "nerfmodal",
        "serverDescription": f"nerfmodal {package_version()}",
        "organizationName": owner,
    }
    return single_of(about | {"calls": calls})


@router.get("/commoncropnames")
def crops(parts: TheParts, owner: Owner, page: Page = 0, size: Size = 1000) -> dict[str, object]:
    """The species of the plants."""
    with parts.store.read() as session:
        names = sorted(name for name in count_by(session, Plant.species, owner=owner) if name)
    found = page_of([], page, size, len(names)).model_dump()
    found["result"]["data"] = names[page * size : (page + 1) * size]
    return found


@router.get("/trials")
def trials(parts: TheParts, owner: Owner, page: Page = 0, size: Size = 1000) -> BrapiPage:
    """A trial for each study."""
    with parts.store.read() as session:
        names = sorted(count_by(session, Plant.study, owner=owner), key=lambda name: name or UNASSIGNED)
    return page_of([trial_of(name) for name in names[page * size : (page + 1) * size]], page, size, len(names))


@router.get("/studies")
def studies(parts: TheParts, owner: Owner, page: Page = 0, size: Size = 1000) -> BrapiPage:
    """The studies that plants belong to."""
    with parts.store.read() as session:
        counts = count_by(session, Plant.study, owner=owner)
    names = sorted(counts, key=lambda name: name or UNASSIGNED)[page * size : (page + 1) * size]
    return page_of([study_of(name, counts[name]) for name in names], page, size, len(counts))


@router.get("/observationunits")
def units(parts: TheParts, owner: Owner, page: Page = 0, size: Size = 1000, study: Study = None) -> BrapiPage:
    """The plants."""
    filters = Filters(studies=(study,) if study else ())
    with parts.store.read() as session:
        total = count_plants(session, owner=owner, filters=filters)
        found = list_plants(
            session, owner=owner, filters=filters, order=Order(), limit=size, offset=min(page * size, total)
        )
    return page_of([unit_of(plant) for plant in found], page, size, total)


@router.get("/variables")
def variables(_: Owner, page: Page = 0, size: Size = 1000) -> BrapiPage:
    """What is measured."""
    rows = [variable_of(trait) for trait in TRAITS]
    return page_of(rows[page * size : (page + 1) * size], page, size, len(rows))


@router.get("/observations")
def observations(
    parts: TheParts,
    owner: Owner,
    page: Page = 0,
    size: Size = 1000,
    study: Study = None,
    unit: Unit = None,
    variable: Variable = None,
) -> BrapiPage:
    """Every trait of every track at every scan, plant by plant, the oldest first."""
    traits, extent = traits_called(variable), Extent(owner=owner, study=study, plant=unit)
    first, last = page * size, (page + 1) * size
    if not traits:
        return page_of([], page, size, 0)
    with parts.store.read() as session:
        total = count_observed(session, extent) * len(traits)
        skipped = min(first, total) // len(traits)
        query = observed(extent).offset(skipped).limit(size // len(traits) + 2)
        rows = [observation_of(trait, *row) for row in session.execute(query) for trait in traits]
    begin = first - skipped * len(traits)
    return page_of(rows[begin : begin + last - first], page, size, total)
