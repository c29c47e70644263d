"""Schedules: plants that are scanned again and again by themselves."""

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response
from scanjobs.fleet.plants import get_plant
from scanjobs.fleet.schedules import (
    add_schedule,
    change_schedule,
    get_schedule,
    list_schedules,
    remove_schedule,
    runs_of,
)
from scanjobs.fleet.tables import Plant, Schedule
from sqlalchemy.orm import Session

from services.api.dependencies import Owner, Submitter, TheParts, uuid_of
from services.api.routes.plants import PlantWord
from services.api.routes.scans import refuse_unstorable
from services.api.schemas_schedules import (
    NewSchedule,
    RunDetail,
    RunList,
    ScheduleChange,
    ScheduleDetail,
    SchedulePage,
)

WHERE = "GET /v1/schedules"
LIST = "schedules"
ScheduleId = Annotated[str, Path(description="Id of a schedule.")]
router = APIRouter(prefix="/v1/schedules", tags=["schedules"])


@router.post("", status_code=201)
def create(asked: NewSchedule, parts: TheParts, owner: Submitter, response: Response) -> ScheduleDetail:
    """Have a plant scanned every so many hours, or at times as of cron."""
    refuse_unstorable(asked.spec)
    columns = {"every_hours": None, "cron": None} | asked.columns()

    def work(session: Session) -> ScheduleDetail:
        plant = get_plant(session, asked.plant, owner=owner)
        return ScheduleDetail.of(add_schedule(session, plant, columns), plant, None)

    made = parts.store.write(work)
    response.headers["Location"] = f"/v1/schedules/{made.id}"
    return made


@router.get("")
def list_(
    parts: TheParts,
    owner: Owner,
    plant: Annotated[PlantWord | None, Query()] = None,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> SchedulePage:
    """Schedules with what became of their last time, the newest first."""
    before = cursor and parts.cursors.read(cursor, owner=owner, list_name=LIST)
    with parts.store.read() as session:
        found = list_schedules(session, owner=owner, plant_id=plant, before=before, limit=limit + 1)
        items = [_detail(session, *row) for row in found[:limit]]
    more = parts.cursors.write(found[limit - 1][0].id, owner=owner, list_name=LIST) if len(found) > limit else None
    return SchedulePage(items=items, next_cursor=more)


@router.get("/{schedule_id}")
def show(schedule_id: ScheduleId, parts: TheParts, owner: Owner) -> ScheduleDetail:
    """One schedule."""
    with parts.store.read() as session:
        return _detail(session, *get_schedule(session, uuid_of(schedule_id, "schedule", WHERE), owner=owner))


@router.patch("/{schedule_id}")
def change(schedule_id: ScheduleId, asked: ScheduleChange, parts: TheParts, owner: Submitter) -> ScheduleDetail:
    """Change what is given; another time counts from now."""
    which = uuid_of(schedule_id, "schedule", WHERE)
    if asked.spec is not None:
        refuse_unstorable(asked.spec)
    columns = asked.columns()

    def work(session: Session) -> ScheduleDetail:
        schedule, plant = get_schedule(session, which, owner=owner)
        change_schedule(session, schedule, columns)
        return _detail(session, schedule, plant)

    return parts.store.write(work)


@router.delete("/{schedule_id}", status_code=204)
def delete(schedule_id: ScheduleId, parts: TheParts, owner: Submitter) -> None:
    """Scan the plant no more by itself."""
    which = uuid_of(schedule_id, "schedule", WHERE)
    parts.store.write(lambda session: remove_schedule(session, which, owner=owner))


@router.get("/{schedule_id}/runs")
def runs(
    schedule_id: ScheduleId, parts: TheParts, owner: Owner, limit: Annotated[int, Query(ge=1, le=500)] = 50
) -> RunList:
    """What became of the times of a schedule, the newest first."""
    which = uuid_of(schedule_id, "schedule", WHERE)
    with parts.store.read() as session:
        schedule, _ = get_schedule(session, which, owner=owner)
        return RunList(items=[RunDetail.of(row) for row in runs_of(session, schedule, limit)])


def _detail(session: Session, schedule: Schedule, plant: Plant) -> ScheduleDetail:
    last = runs_of(session, schedule, 1)
    return ScheduleDetail.of(schedule, plant, last[0] if last else None)
