"""The fleet as a whole: what there is to filter by, and treatments side by side."""

from typing import Annotated

from fastapi import APIRouter, Query
from scanjobs.fleet.alarms import count_alarmed
from scanjobs.fleet.plants import NEVER, count_by, count_tags
from scanjobs.fleet.tables import Plant
from scanjobs.fleet.treatments import boxes_by_treatment
from scanjobs.states import ScanState

from services.api.dependencies import Owner, TheParts
from services.api.schemas import STATUS_OF
from services.api.schemas_plants import Facets, Label, Moment
from services.api.schemas_treatments import TreatmentList, treatment_of

router = APIRouter(prefix="/v1/fleet", tags=["plants"])


@router.get("")
def facets(parts: TheParts, owner: Owner) -> Facets:
    """How many plants there are by treatment, study, tag and state."""
    with parts.store.read() as session:
        states = count_by(session, Plant.last_scan_state, owner=owner)
        by_treatment = count_by(session, Plant.treatment, owner=owner)
        by_study = count_by(session, Plant.study, owner=owner)
        tags = count_tags(session, owner=owner)
        alarms = count_alarmed(session, owner=owner)
    by_status: dict[str, int] = {}
    for exact, count in states.items():
        status = NEVER if exact is None else STATUS_OF.get(ScanState(exact), "canceled")
        by_status[status] = by_status.get(status, 0) + count
    return Facets(
        plants=sum(states.values()),
        alarms=alarms,
        treatments={name: count for name, count in by_treatment.items() if name},
        studies={name: count for name, count in by_study.items() if name},
        tags=tags,
        states=by_status,
    )


@router.get("/treatments")
def treatments(
    parts: TheParts,
    owner: Owner,
    study: Annotated[Label | None, Query()] = None,
    since: Moment | None = None,
    until: Moment | None = None,
) -> TreatmentList:
    """f/f0 of all tracks together by treatment and day (UTC), as box plots: one value for each plant and day."""
    with parts.store.read() as session:
        found = boxes_by_treatment(
            session,
            owner=owner,
            study=study,
            since=since.timestamp() if since else None,
            until=until.timestamp() if until else None,
        )
    return TreatmentList(items=[treatment_of(name, *boxes) for name, boxes in found.items()])
