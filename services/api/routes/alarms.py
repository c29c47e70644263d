"""Alarms: what is not as it should be, acknowledged and closed by people."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from scanjobs.fleet.alarms import change_alarm, get_alarm, list_alarms
from scanjobs.fleet.joining import join_plant
from scanjobs.fleet.plants import get_plant
from sqlalchemy.orm import Session

from services.api.dependencies import Owner, Submitter, TheParts, uuid_of
from services.api.routes.plants import PlantWord
from services.api.schemas_alarms import AlarmChange, AlarmDetail, AlarmPage

WHERE = "GET /v1/alarms"
LIST = "alarms"
AlarmId = Annotated[str, Path(description="Id of an alarm.")]
AlarmState = Literal["open", "acknowledged", "closed"]
Kind = Literal["drift", "lost_mode", "scans_failing", "scan_missed"]
router = APIRouter(prefix="/v1/alarms", tags=["alarms"])


@router.get("")
def list_(
    parts: TheParts,
    owner: Owner,
    state: Annotated[list[AlarmState] | None, Query()] = None,
    kind: Annotated[list[Kind] | None, Query()] = None,
    plant: Annotated[PlantWord | None, Query()] = None,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> AlarmPage:
    """Alarms, the newest first; several values of a filter are joined by or."""
    before = cursor and parts.cursors.read(cursor, owner=owner, list_name=LIST)
    with parts.store.read() as session:
        found = list_alarms(
            session,
            owner=owner,
            states=tuple(state or ()),
            kinds=tuple(kind or ()),
            plant_id=plant,
            before=before,
            limit=limit + 1,
        )
    more = parts.cursors.write(found[limit - 1][0].id, owner=owner, list_name=LIST) if len(found) > limit else None
    return AlarmPage(items=[AlarmDetail.of(*row) for row in found[:limit]], next_cursor=more)


@router.get("/{alarm_id}")
def show(alarm_id: AlarmId, parts: TheParts, owner: Owner) -> AlarmDetail:
    """One alarm: what changed, since when, how sure, and how long it took."""
    with parts.store.read() as session:
        return AlarmDetail.of(*get_alarm(session, uuid_of(alarm_id, "alarm", WHERE), owner=owner))


@router.patch("/{alarm_id}")
def change(alarm_id: AlarmId, asked: AlarmChange, parts: TheParts, owner: Submitter) -> AlarmDetail:
    """Acknowledge, close or annotate an alarm. 409 when it is closed."""
    which = uuid_of(alarm_id, "alarm", WHERE)

    def work(session: Session) -> AlarmDetail:
        alarm, plant = change_alarm(
            session, which, owner=owner, state=asked.state, note=asked.note, new_reference=asked.new_reference
        )
        if asked.state == "closed":
            join_plant(session, get_plant(session, plant.id, owner=owner))
        return AlarmDetail.of(alarm, plant)

    return parts.store.write(work)
