"""A plant over weeks: its tracks, surroundings, events, charts and alarms in one answer."""

from typing import Annotated

from fastapi import APIRouter, Query
from scanjobs.fleet.history import read_history
from scanjobs.fleet.plants import get_plant

from services.api.dependencies import Owner, TheParts
from services.api.routes.plants import PlantId
from services.api.schemas_history import HistoryDetail, history_detail
from services.api.schemas_plants import Moment

router = APIRouter(prefix="/v1/plants", tags=["plants"])


@router.get("/{plant_id}/history")
def history(
    plant_id: PlantId,
    parts: TheParts,
    owner: Owner,
    since: Moment | None = None,
    until: Moment | None = None,
    max_points: Annotated[int, Query(ge=1, le=10_000, description="At most so many scans, the newest.")] = 500,
) -> HistoryDetail:
    """Everything that is known of a plant between two moments; columns of equal length, oldest first."""
    with parts.store.read() as session:
        plant = get_plant(session, plant_id, owner=owner)
        found = read_history(
            session,
            plant,
            since=since.timestamp() if since else None,
            until=until.timestamp() if until else None,
            most=max_points,
        )
    return history_detail(found)
