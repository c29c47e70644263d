"""Alarms: opened by what is computed, acknowledged and closed by people, told through the webhooks' outbox.

One alarm of a kind and subject is open at a time: while it is, newer evidence replaces the older. It stays open until a
person closes it, or until the data no longer say it (a track corrected by hand, another reference).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Select, func, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.fleet.plants import UNSYNCHRONISED
from scanjobs.fleet.tables import Alarm, Plant
from scanjobs.uuids import new_id
from scanjobs.webhooks import announce

OPEN: Final = "open"
ACKNOWLEDGED: Final = "acknowledged"
CLOSED: Final = "closed"
LIVE: Final = (OPEN, ACKNOWLEDGED)
DRIFT: Final = "drift"
LOST_MODE: Final = "lost_mode"
SCANS_FAILING: Final = "scans_failing"
SCAN_MISSED: Final = "scan_missed"
SEVERITIES: Final = ("notice", "warning", "critical")
BY_DATA: Final = "data"
BY_USER: Final = "user"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why there is an alarm: what `subject` of the plant it is about, and all that is shown of it."""

    kind: str
    subject: str = ""
    severity: str
    evidence: Mapping[str, Any]

    @property
    def cause(self) -> object:
        """What makes it the same alarm as one that a person has closed."""
        return self.evidence.get("detected_at")


def evidence_of(**given: Any) -> dict[str, Any]:
    """The same keys for every kind of alarm."""
    empty: dict[str, Any] = {
        "change_percent": None,
        "change_percent_std": None,
        "confidence": None,
        "charts": [],
        "tracks": [],
        "recovered_at": None,
    }
    return empty | given


def settle_alarms(session: Session, plant: Plant, reasons: Mapping[tuple[str, str], Reason], kinds: set[str]) -> None:
    """Let the plant's live alarms of these kinds be exactly those that there is reason for."""
    for alarm in live_alarms(session, plant):
        if alarm.kind in kinds and (alarm.kind, alarm.subject) not in reasons:
            _move(session, plant, alarm, CLOSED, {"closed_at": now_s(), "closed_by": BY_DATA})
    for reason in reasons.values():
        _raise(session, plant, reason)
    count_alarms(session, plant)


def live_alarms(session: Session, plant: Plant) -> tuple[Alarm, ...]:
    """Open and acknowledged alarms of a plant."""
    query = select(Alarm).where(Alarm.plant_key == plant.key, Alarm.state.in_(LIVE)).order_by(Alarm.id)
    return tuple(session.scalars(query.execution_options(populate_existing=True)))


def count_alarms(session: Session, plant: Plant) -> None:
    """Write into the plant's row how many alarms it has, and how bad the worst is."""
    live = live_alarms(session, plant)
    worst = max((alarm.severity for alarm in live), key=SEVERITIES.index, default=None)
    values = {"open_alarms": len(live), "worst": worst}
    session.execute(update(Plant).where(Plant.key == plant.key).values(values), execution_options=UNSYNCHRONISED)


def get_alarm(session: Session, alarm_id: str, *, owner: str) -> tuple[Alarm, Plant]:
    """An owner's alarm and its plant. Raises `NotFound`."""
    query = _with_plants(owner).where(Alarm.id == alarm_id).execution_options(populate_existing=True)
    row = session.execute(query).one_or_none()
    if row is None:
        raise NotFound(f"there is no alarm {alarm_id}.", hint="List yours with GET /v1/alarms.")
    return row[0], row[1]


def list_alarms(
    session: Session,
    *,
    owner: str,
    states: tuple[str, ...] = (),
    kinds: tuple[str, ...] = (),
    plant_id: str | None = None,
    before: str | None = None,
    limit: int = 50,
) -> tuple[tuple[Alarm, Plant], ...]:
    """Alarms with their plants, the newest first."""
    query = _with_plants(owner)
    if states:
        query = query.where(Alarm.state.in_(states))
    if kinds:
        query = query.where(Alarm.kind.in_(kinds))
    if plant_id is not None:
        query = query.where(Plant.id == plant_id)
    if before is not None:
        query = query.where(Alarm.id < before)
    return tuple((row[0], row[1]) for row in session.execute(query.order_by(Alarm.id.desc()).limit(limit)))


def change_alarm(
    session: Session, alarm_id: str, *, owner: str, state: str | None, note: str | None, new_reference: bool = False
) -> tuple[Alarm, Plant]:
    """Acknowledge, close or annotate an alarm; a closed drift begins the charts anew, and f0 too if asked for.

    Raises
    ------
    NotFound
        No such alarm.
    IllegalTransition
        It is closed.
    """
    alarm, plant = get_alarm(session, alarm_id, owner=owner)
    if alarm.state == CLOSED:
        raise IllegalTransition("the alarm is closed.", hint="A closed alarm stays as it is.")
    if note is not None:
        session.execute(update(Alarm).where(Alarm.id == alarm.id).values(note=note), execution_options=UNSYNCHRONISED)
        session.refresh(alarm)
    if state == ACKNOWLEDGED and alarm.state == OPEN:
        _move(session, plant, alarm, ACKNOWLEDGED, {"acknowledged_at": now_s()})
    if state == CLOSED:
        _move(session, plant, alarm, CLOSED, {"closed_at": now_s(), "closed_by": BY_USER})
        if alarm.kind == DRIFT:
            _begin_anew(session, plant, new_reference=new_reference)
    count_alarms(session, plant)
    return get_alarm(session, alarm_id, owner=owner)


def count_alarmed(session: Session, *, owner: str) -> int:
    """How many plants have a live alarm."""
    return session.scalars(select(func.count()).where(Plant.owner == owner, Plant.open_alarms > 0)).one()


def document_of(alarm: Alarm, plant: Plant) -> dict[str, Any]:
    """An alarm as the API and the webhooks tell it; times are seconds since 1970."""
    return {
        "id": alarm.id,
        "plant": plant.id,
        "plant_name": plant.name,
        "treatment": plant.treatment,
        "kind": alarm.kind,
        "severity": alarm.severity,
        "state": alarm.state,
        **alarm.evidence,
        "opened_at": alarm.opened_at,
        "acknowledged_at": alarm.acknowledged_at,
        "closed_at": alarm.closed_at,
        "closed_by": alarm.closed_by,
        "note": alarm.note,
    }


def _with_plants(owner: str) -> Select[Alarm, Plant]:
    return select(Alarm, Plant).join(Plant, Plant.key == Alarm.plant_key).where(Alarm.owner == owner)


def _raise(session: Session, plant: Plant, reason: Reason) -> None:
    query = select(Alarm).where(
        Alarm.plant_key == plant.key, Alarm.kind == reason.kind, Alarm.subject == reason.subject
    )
    last = session.scalars(query.order_by(Alarm.id.desc()).limit(1)).one_or_none()
    if last is not None and last.state in LIVE:
        values = {"evidence": dict(reason.evidence), "severity": reason.severity}
        session.execute(update(Alarm).where(Alarm.id == last.id).values(values), execution_options=UNSYNCHRONISED)
    elif last is None or last.evidence.get("detected_at") != reason.cause:
        _open(session, plant, reason)


def _open(session: Session, plant: Plant, reason: Reason) -> None:
    alarm_id = new_id()
    row = {
        "id": alarm_id,
        "owner": plant.owner,
        "plant_key": plant.key,
        "kind": reason.kind,
        "subject": reason.subject,
        "severity": reason.severity,
        "state": OPEN,
        "evidence": dict(reason.evidence),
        "opened_at": now_s(),
        "note": "",
    }
    session.execute(insert(Alarm).values(row))
    _tell(session, plant, session.get_one(Alarm, alarm_id), "opened")


def _move(session: Session, plant: Plant, alarm: Alarm, state: str, values: Mapping[str, Any]) -> None:
    moved = update(Alarm).where(Alarm.id == alarm.id).values({"state": state, **values})
    session.execute(moved, execution_options=UNSYNCHRONISED)
    session.refresh(alarm)
    _tell(session, plant, alarm, state)


def _tell(session: Session, plant: Plant, alarm: Alarm, what: str) -> None:
    announce(session, owner=plant.owner, kind=f"alarm.{what}", data=document_of(alarm, plant))


def _begin_anew(session: Session, plant: Plant, *, new_reference: bool) -> None:
    values: dict[str, Any] = {"charts_from": now_s(), "touched": Plant.touched + 1}
    if new_reference:
        values |= {"reference_from": now_s(), "reference_until": None}
    session.execute(update(Plant).where(Plant.key == plant.key).values(values), execution_options=UNSYNCHRONISED)
