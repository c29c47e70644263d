"""Schedules: when a plant is scanned again. A chore submits what is due; what could not be is noted as missed.

A time is every so many hours, or five fields as of cron in a time zone of its own (by `cronsim`, which skips what a
change to summer time leaves out). What is due waits for its source until the grace is over: files may be late.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from cronsim import CronSim, CronSimError
from nerfmodal.errors import InvalidInput
from nerfmodal.spec import PlantSpec, ScanSpec
from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import NotFound, ScanjobsError
from scanjobs.fleet.alarms import SCAN_MISSED, Reason, evidence_of, settle_alarms
from scanjobs.fleet.plants import UNSYNCHRONISED
from scanjobs.fleet.tables import Plant, Schedule, ScheduleRun
from scanjobs.repository import Idempotency, insert_scan
from scanjobs.settings import Settings
from scanjobs.uuids import new_id

SUBMITTED: Final = "submitted"
MISSED: Final = "missed"
MINUTE_S: Final = 60.0
HOUR_S: Final = 3600.0


def next_time(schedule: Schedule, after: float) -> float:
    """The first time of a schedule behind a moment (s)."""
    if schedule.every_hours is not None:
        pause = schedule.every_hours * HOUR_S
        behind = max(after - schedule.next_due_at, 0.0) // pause + 1.0 if schedule.next_due_at <= after else 0.0
        return schedule.next_due_at + behind * pause
    return next_of_cron(schedule.cron or "", schedule.time_zone, after)


def next_of_cron(cron: str, time_zone: str, after: float) -> float:
    """The first time of five cron fields in a time zone.

    Raises
    ------
    InvalidInput
        The fields, or the zone, are none; or they never come.
    """
    try:
        begin = datetime.fromtimestamp(after, zone_of(time_zone))
        return float(next(CronSim(cron, begin)).timestamp())
    except (CronSimError, StopIteration) as error:
        hint = "Write minute hour day month weekday, such as: 0 6,18 * * *"
        raise InvalidInput(f"'{cron}' is no time of cron: {error}.", where="/cron", hint=hint) from error


def zone_of(name: str) -> ZoneInfo:
    """The time zone of an IANA name. Raises `InvalidInput`."""
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        hint = "Use a name such as America/Belem or UTC."
        raise InvalidInput(f"'{name}' is no time zone.", where="/time_zone", hint=hint) from error


def add_schedule(session: Session, plant: Plant, values: Mapping[str, Any]) -> Schedule:
    """A new schedule of a plant; the first time is one pause from now, or the next of cron."""
    now = session.scalars(select(now_s())).one()
    schedule = Schedule(id=new_id(), owner=plant.owner, plant_key=plant.key, created_at=now, next_due_at=now, **values)
    schedule.next_due_at = next_time(schedule, now)
    session.add(schedule)
    session.flush()
    return schedule


def get_schedule(session: Session, schedule_id: str, *, owner: str) -> tuple[Schedule, Plant]:
    """An owner's schedule and its plant. Raises `NotFound`."""
    query = select(Schedule, Plant).join(Plant, Plant.key == Schedule.plant_key)
    row = session.execute(query.where(Schedule.id == schedule_id, Schedule.owner == owner)).one_or_none()
    if row is None:
        raise NotFound(f"there is no schedule {schedule_id}.", hint="List yours with GET /v1/schedules.")
    return row[0], row[1]


def list_schedules(
    session: Session, *, owner: str, plant_id: str | None = None, before: str | None = None, limit: int = 50
) -> tuple[tuple[Schedule, Plant], ...]:
    """An owner's schedules with their plants, the newest first."""
    query = select(Schedule, Plant).join(Plant, Plant.key == Schedule.plant_key).where(Schedule.owner == owner)
    if plant_id is not None:
        query = query.where(Plant.id == plant_id)
    if before is not None:
        query = query.where(Schedule.id < before)
    return tuple((row[0], row[1]) for row in session.execute(query.order_by(Schedule.id.desc()).limit(limit)))


def change_schedule(session: Session, schedule: Schedule, values: Mapping[str, Any]) -> None:
    """Change some columns; another time, or being enabled again, counts from now."""
    for name, value in values.items():
        setattr(schedule, name, value)
    if {"every_hours", "cron", "time_zone", "enabled"} & values.keys():
        schedule.next_due_at = session.scalars(select(now_s())).one()
        schedule.next_due_at = next_time(schedule, schedule.next_due_at)
    session.flush()


def remove_schedule(session: Session, schedule_id: str, *, owner: str) -> None:
    """Forget a schedule. Raises `NotFound`."""
    schedule, _ = get_schedule(session, schedule_id, owner=owner)
    session.execute(delete(Schedule).where(Schedule.id == schedule.id))


def runs_of(session: Session, schedule: Schedule, limit: int = 50) -> tuple[ScheduleRun, ...]:
    """What became of the times of a schedule, the newest first."""
    query = select(ScheduleRun).where(ScheduleRun.schedule_id == schedule.id)
    return tuple(session.scalars(query.order_by(ScheduleRun.due_at.desc()).limit(limit)))


def next_due_of(session: Session, plant_keys: Sequence[str]) -> dict[str, float]:
    """When plants are scanned next, of those that have a schedule."""
    query = select(Schedule.plant_key, func.min(Schedule.next_due_at)).where(
        Schedule.plant_key.in_(plant_keys), Schedule.enabled
    )
    return {row[0]: row[1] for row in session.execute(query.group_by(Schedule.plant_key))}


def due_schedules(session: Session, most: int = 50) -> tuple[str, ...]:
    """Schedules whose time has come, the longest due first."""
    query = select(Schedule.id).where(Schedule.enabled, Schedule.next_due_at <= now_s())
    return tuple(session.scalars(query.order_by(Schedule.next_due_at).limit(most)))


def run_due(session: Session, settings: Settings, schedule_id: str) -> str | None:
    """Submit the scan that is due, or note that it was missed; None while its source is waited for."""
    held = select(Schedule).where(Schedule.id == schedule_id).with_for_update()
    schedule = session.scalars(held.execution_options(populate_existing=True)).one_or_none()
    now = session.scalars(select(now_s())).one()
    if schedule is None or not schedule.enabled or schedule.next_due_at > now:
        return None
    plant, due = session.get_one(Plant, schedule.plant_key), schedule.next_due_at
    late = now - due > schedule.grace_minutes * MINUTE_S
    scan_id, reason = _submit(session, settings, schedule, plant, due)
    if scan_id is None and not late:
        return None
    state = MISSED if scan_id is None else SUBMITTED
    run = {"schedule_id": schedule.id, "due_at": due, "state": state, "scan_id": scan_id, "reason": reason[:255]}
    session.execute(insert(ScheduleRun).values(run))
    schedule.next_due_at = next_time(schedule, due)
    session.flush()
    _tell(session, plant, schedule, run)
    return state


def scheduled_spec(schedule: Schedule, plant: Plant, due: float) -> ScanSpec:
    """The specification of one time: {plant}, {date} and {time} filled in, as the schedule's zone has them."""
    at = datetime.fromtimestamp(due, zone_of(schedule.time_zone))
    words = {"{plant}": plant.id, "{date}": f"{at:%Y-%m-%d}", "{time}": f"{at:%H%M}"}
    document = dict(schedule.spec)
    source = dict(document["source"])
    for word, value in words.items():
        if "path" in source:
            source["path"] = source["path"].replace(word, value)
    document |= {"source": source, "plant": PlantSpec(id=plant.id).model_dump(mode="json")}
    return ScanSpec.model_validate(document)


def _submit(
    session: Session, settings: Settings, schedule: Schedule, plant: Plant, due: float
) -> tuple[str | None, str]:
    """The scan's id, or None and why there is none."""
    from scanjobs.captures import locate_source  # here: it reads pictures, which a worker without schedules never does

    spec = scheduled_spec(schedule, plant, due)
    try:
        located = (
            spec if spec.source.kind == "simulation" else locate_source(session, settings, spec, owner=plant.owner)
        )
    except (ScanjobsError, InvalidInput) as error:
        return None, error.message
    key = Idempotency(f"schedule {schedule.id} {due:.3f}", located.digest())
    return insert_scan(session, located, owner=plant.owner, idempotency=key).scan.id, ""


def _tell(session: Session, plant: Plant, schedule: Schedule, run: Mapping[str, Any]) -> None:
    """A missed scan is counted and is an alarm until the next one is there."""
    reasons = {}
    if run["state"] == MISSED:
        missed = update(Plant).where(Plant.key == plant.key).values(missed_scans=Plant.missed_scans + 1)
        session.execute(missed, execution_options=UNSYNCHRONISED)
        when = datetime.fromtimestamp(run["due_at"], UTC)
        evidence = evidence_of(
            title=f"The scan of {when:%d %b %Y %H:%M} UTC was missed",
            what=f"It was due and not submitted within {timedelta(minutes=schedule.grace_minutes)}: {run['reason']}",
            since=run["due_at"],
            since_scan=None,
            detected_at=run["due_at"] + schedule.grace_minutes * MINUTE_S,
            detected_scan=None,
            delay_scans=None,
            delay_s=schedule.grace_minutes * MINUTE_S,
        )
        reason = Reason(kind=SCAN_MISSED, subject=schedule.id, severity="notice", evidence=evidence)
        reasons[reason.kind, reason.subject] = reason
    settle_alarms(session, plant, reasons, {SCAN_MISSED})
