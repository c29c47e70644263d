"""Plants: make, change, find. Every function takes the caller's session and an owner; the caller commits.

A plant is named by its owner's own word. What a list shows stands in the plant's row, so a page of a fleet is one
query over one table, filtered and sorted by indexed columns.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

from nerfmodal.spec import PlantSpec
from sqlalchemy import ColumnElement, Select, and_, delete, func, insert, or_, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.fleet.tables import Plant, PlantTag
from scanjobs.table_base import table_of
from scanjobs.uuids import new_id

SORTS: Final[Mapping[str, Any]] = {
    "id": Plant.id,
    "name": func.lower(Plant.name),
    "position": func.coalesce(Plant.position, ""),
    "treatment": func.coalesce(Plant.treatment, ""),
    "last_scan": func.coalesce(Plant.last_scan_at, 0.0),
    "frequency": func.coalesce(Plant.frequency_hz, 0.0),
    "ratio": func.coalesce(Plant.ratio, 0.0),
    "alarms": Plant.open_alarms,
}
"""What a list can be sorted by; ties are broken by the plant's key, so that no page overlaps another."""
NEVER: Final = "none"
"""The state of a plant that was never scanned."""
UNSYNCHRONISED: Final = {"synchronize_session": False}


class PlantExists(IllegalTransition):
    """There is a plant of this id already; change it with PATCH, or choose another id."""

    code = "PLANT_EXISTS"


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """Which plants: several values of one field are joined by or, the fields by and. `states` are exact scan states."""

    treatments: Collection[str] = ()
    tags: Collection[str] = ()
    states: Collection[str] = ()
    studies: Collection[str] = ()
    severities: Collection[str] = ()
    alarm: bool | None = None
    text: str | None = None


@dataclass(frozen=True, slots=True)
class Order:
    """By which of `SORTS`, and whether the largest comes first."""

    by: str = "id"
    descending: bool = False

    @classmethod
    def parse(cls, text: str) -> "Order":
        """`-alarms` is by alarms, the largest first."""
        return cls(text.removeprefix("-"), text.startswith("-"))


def add_plant(session: Session, plant_id: str, values: Mapping[str, Any], *, owner: str) -> Plant:
    """A new plant. Raises `PlantExists`."""
    if not _insert(session, plant_id, values, owner=owner):
        raise PlantExists(f"there is a plant '{plant_id}' already.", where="/id", hint="Change it with PATCH.")
    plant = get_plant(session, plant_id, owner=owner)
    write_tags(session, plant, values.get("tags") or [])
    return plant


LONGEST_WORD: Final = 64
"""Of a treatment or position in a plant's row; a specification's may be longer."""


def ensure_plant(session: Session, spec: PlantSpec, *, owner: str) -> str:
    """The key of the plant that a specification names, made if it is not there; fills in what the row lacks."""
    said = {"treatment": spec.treatment, "position": spec.position}
    given = {name: (value or "").replace("\x00", "")[:LONGEST_WORD] or None for name, value in said.items()}
    _insert(session, spec.id, given, owner=owner)
    mine = (Plant.owner == owner, Plant.id == spec.id)
    filled = {name: func.coalesce(getattr(Plant, name), value) for name, value in given.items() if value}
    if filled:
        session.execute(update(Plant).where(*mine).values(filled), execution_options=UNSYNCHRONISED)
    return session.scalars(select(Plant.key).where(*mine)).one()


def get_plant(session: Session, plant_id: str, *, owner: str) -> Plant:
    """An owner's plant. Raises `NotFound`."""
    query = select(Plant).where(Plant.owner == owner, Plant.id == plant_id)
    plant = session.scalars(query.execution_options(populate_existing=True)).one_or_none()
    if plant is None:
        raise NotFound(f"there is no plant '{plant_id}'.", hint="List yours with GET /v1/plants.")
    return plant


def change_plant(session: Session, plant_id: str, values: Mapping[str, Any], *, owner: str) -> Plant:
    """Change some columns, `tags` among them; the plant is then to be looked at again. Raises `NotFound`."""
    plant = get_plant(session, plant_id, owner=owner)
    changes = {**values, "touched": Plant.touched + 1}
    session.execute(update(Plant).where(Plant.key == plant.key).values(changes), execution_options=UNSYNCHRONISED)
    if "tags" in values:
        write_tags(session, plant, values["tags"])
    session.refresh(plant)
    return plant


def remove_plant(session: Session, plant_id: str, *, owner: str) -> None:
    """Forget a plant with its tracks and alarms; its scans stay. Raises `NotFound`."""
    session.execute(delete(Plant).where(Plant.key == get_plant(session, plant_id, owner=owner).key))


def write_tags(session: Session, plant: Plant, tags: Collection[str]) -> None:
    """The words that the plant is found by, in the place of those before."""
    session.execute(delete(PlantTag).where(PlantTag.plant_key == plant.key))
    rows = [{"plant_key": plant.key, "tag": tag} for tag in sorted(set(tags))]
    if rows:
        session.execute(insert(table_of(PlantTag)), rows)


def list_plants(
    session: Session,
    *,
    owner: str,
    filters: Filters,
    order: Order,
    after: tuple[Any, str] | None = None,
    limit: int = 50,
    offset: int = 0,
) -> tuple[Plant, ...]:
    """The plants behind the place `after` (what was sorted by, and the key), without the first `offset` of them."""
    column = SORTS[order.by]
    query = select(Plant).where(*_chosen(owner, filters))
    if after is not None:
        query = query.where(_behind(column, order, after))
    ways = (column.desc(), Plant.key.desc()) if order.descending else (column.asc(), Plant.key.asc())
    return tuple(session.scalars(query.order_by(*ways).limit(limit).offset(offset)))


def count_plants(session: Session, *, owner: str, filters: Filters) -> int:
    """How many plants a list has in all."""
    return session.scalars(select(func.count()).select_from(Plant).where(*_chosen(owner, filters))).one()


def place_of(plant: Plant, order: Order) -> tuple[Any, str]:
    """Where a plant stands in a list: what `list_plants` goes on from."""
    text = {"name": plant.name.lower(), "position": plant.position or "", "treatment": plant.treatment or ""}
    number = {
        "last_scan": plant.last_scan_at,
        "frequency": plant.frequency_hz,
        "ratio": plant.ratio,
        "alarms": plant.open_alarms,
    }
    value = text[order.by] if order.by in text else number[order.by] or 0.0 if order.by in number else plant.id
    return value, plant.key


def count_by(session: Session, column: Any, *, owner: str) -> dict[str | None, int]:
    """How many plants there are of each value of a column."""
    query = select(column, func.count()).where(Plant.owner == owner).group_by(column)
    return {row[0]: row[1] for row in session.execute(query)}


def count_tags(session: Session, *, owner: str) -> dict[str, int]:
    """How many plants have each tag."""
    query = select(PlantTag.tag, func.count()).join(Plant, Plant.key == PlantTag.plant_key)
    rows = session.execute(query.where(Plant.owner == owner).group_by(PlantTag.tag))
    return {row[0]: row[1] for row in rows}


def _insert(session: Session, plant_id: str, values: Mapping[str, Any], *, owner: str) -> bool:
    """Insert the row unless there is one; whether it was inserted."""
    dialect = postgresql if session.get_bind().dialect.name == "postgresql" else sqlite
    row = {
        "key": new_id(),
        "owner": owner,
        "id": plant_id,
        "name": plant_id,
        "created_at": now_s(),
        "notes": "",
        "tags": [],
        "latest": [],
        "spark": [],
        "demo": False,
        "reference_scans": 12,
        "false_alarms_per_year": 0.1,
        "growth": False,
        "scans": 0,
        "open_alarms": 0,
        "missed_scans": 0,
        "touched": 0,
        "joined": 0,
        **{name: value for name, value in values.items() if value is not None},
    }
    made = dialect.insert(table_of(Plant)).values(row).on_conflict_do_nothing(index_elements=["owner", "id"])
    return session.execute(made.returning(table_of(Plant).c.key)).one_or_none() is not None


def _chosen(owner: str, filters: Filters) -> list[ColumnElement[bool]]:
    found: list[ColumnElement[bool]] = [Plant.owner == owner]
    if filters.treatments:
        found.append(Plant.treatment.in_(filters.treatments))
    if filters.studies:
        found.append(Plant.study.in_(filters.studies))
    if filters.severities:
        found.append(Plant.worst.in_(filters.severities))
    if filters.tags:
        tagged: Select[str] = select(PlantTag.plant_key).where(PlantTag.tag.in_(filters.tags))
        found.append(Plant.key.in_(tagged))
    if filters.states:
        scanned = Plant.last_scan_state.in_([state for state in filters.states if state != NEVER])
        found.append(or_(scanned, Plant.last_scan_state.is_(None)) if NEVER in filters.states else scanned)
    if filters.alarm is not None:
        found.append(Plant.open_alarms > 0 if filters.alarm else Plant.open_alarms == 0)
    if filters.text:
        found.append(_mentions(filters.text))
    return found


def _mentions(text: str) -> ColumnElement[bool]:
    columns = (Plant.id, Plant.name, Plant.position, Plant.species, Plant.genotype)
    return or_(*(column.icontains(text, autoescape=True) for column in columns))


def _behind(column: Any, order: Order, after: tuple[Any, str]) -> ColumnElement[bool]:
    value, key = after
    if order.descending:
        return or_(column < value, and_(column == value, Plant.key < key))
    return or_(column > value, and_(column == value, Plant.key > key))
