"""The fleet as a whole: what there is to filter by, and treatments side by side."""

from fastapi import APIRouter
from scanjobs.fleet.alarms import count_alarmed
from scanjobs.fleet.plants import NEVER, count_by, count_tags
from scanjobs.fleet.tables import Plant
from scanjobs.states import ScanState

from services.api.dependencies import Owner, TheParts
from services.api.schemas import STATUS_OF
from services.api.schemas_plants import Facets

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
