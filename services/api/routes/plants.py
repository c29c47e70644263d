"""Plants: what is scanned again and again; the pages of a fleet, filtered and sorted by the database."""

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Response
from pydantic import StringConstraints
from scanjobs.fleet.environment import add_event, list_events, remove_event
from scanjobs.fleet.joining import join_plant
from scanjobs.fleet.plants import (
    NEVER,
    SORTS,
    Filters,
    Order,
    add_plant,
    change_plant,
    get_plant,
    list_plants,
    place_of,
    remove_plant,
)
from scanjobs.fleet.schedules import next_due_of
from scanjobs.fleet.tracks import list_tracks
from sqlalchemy.orm import Session

from services.api.dependencies import Owner, Parts, Submitter, TheParts, uuid_of
from services.api.schemas import STATES_OF
from services.api.schemas_plants import (
    WORD,
    EventDetail,
    EventList,
    Label,
    LongLabel,
    NewEvent,
    NewPlant,
    PlantChange,
    PlantDetail,
    PlantPage,
    PlantRow,
    Severity,
)
from services.api.schemas_tracks import detail_of

LIST = "plants"
WAYS = "|".join(SORTS)
PlantWord = Annotated[str, StringConstraints(min_length=1, max_length=64, pattern=WORD)]
PlantId = Annotated[
    str, Path(pattern=WORD, max_length=64, description="The plant's id: the word that specifications name it by.")
]
Words = Annotated[list[Label] | None, Query(max_length=32)]
router = APIRouter(prefix="/v1/plants", tags=["plants"])


@router.get("")
def list_(
    parts: TheParts,
    owner: Owner,
    treatment: Words = None,
    tag: Words = None,
    study: Words = None,
    state: Annotated[
        list[Annotated[str, Query(pattern=f"^({'|'.join(STATES_OF)}|{NEVER})$")]] | None,
        Query(max_length=8, description="Of the last scan; `none` was never scanned."),
    ] = None,
    alarm: Annotated[bool | None, Query(description="With, or without, an open alarm.")] = None,
    severity: Annotated[list[Severity] | None, Query(description="Of the worst open alarm.")] = None,
    text: Annotated[LongLabel | None, Query(description="Part of id, name, position, species, genotype.")] = None,
    sort: Annotated[str, Query(pattern=f"^-?({WAYS})$", description="`-` before it: the largest first.")] = "id",
    cursor: Annotated[str | None, Query(max_length=1024)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> PlantPage:
    """Plants with their latest frequencies, a sparkline, the state of the last scan and open alarms."""
    order = Order.parse(sort)
    name = f"{LIST} by {sort}"
    place = cursor and parts.cursors.read(cursor, owner=owner, list_name=name)
    filters = Filters(
        treatments=treatment or (),
        tags=tag or (),
        studies=study or (),
        states=_exact(state or ()),
        severities=severity or (),
        alarm=alarm,
        text=text,
    )
    after = (place[0], place[1]) if place else None
    with parts.store.read() as session:
        found = list_plants(session, owner=owner, filters=filters, order=order, after=after, limit=limit + 1)
        due = next_due_of(session, [row.key for row in found[:limit]])
    more = None
    if len(found) > limit:
        more = parts.cursors.write(place_of(found[limit - 1], order), owner=owner, list_name=name)
    return PlantPage(items=[PlantRow.of(row, due.get(row.key)) for row in found[:limit]], next_cursor=more)


@router.post("", status_code=201)
def create(asked: NewPlant, parts: TheParts, owner: Submitter, response: Response) -> PlantDetail:
    """Make a plant before its first scan; a scan whose specification names one makes it too. 409 if it is there."""
    columns = asked.columns(asked.id)
    parts.store.write(lambda session: add_plant(session, asked.id, columns, owner=owner))
    response.headers["Location"] = f"/v1/plants/{asked.id}"
    return look(parts, asked.id, owner)


@router.get("/{plant_id}")
def show(plant_id: PlantId, parts: TheParts, owner: Owner) -> PlantDetail:
    """A plant with its tracks."""
    return look(parts, plant_id, owner)


@router.patch("/{plant_id}")
def change(plant_id: PlantId, asked: PlantChange, parts: TheParts, owner: Submitter) -> PlantDetail:
    """Change what is given; another reference or way of watching is computed at once."""
    columns = asked.columns(plant_id)

    def work(session: Session) -> None:
        plant = change_plant(session, plant_id, columns, owner=owner)
        if {"reference", "monitoring"} & asked.model_fields_set:
            join_plant(session, plant)

    parts.store.write(work)
    return look(parts, plant_id, owner)


@router.delete("/{plant_id}", status_code=204)
def delete(plant_id: PlantId, parts: TheParts, owner: Submitter) -> None:
    """Forget a plant with its tracks, alarms and records; its scans stay."""
    parts.store.write(lambda session: remove_plant(session, plant_id, owner=owner))


@router.get("/{plant_id}/events")
def events(plant_id: PlantId, parts: TheParts, owner: Owner) -> EventList:
    """What was done to the plant, oldest first."""
    with parts.store.read() as session:
        found = list_events(session, get_plant(session, plant_id, owner=owner))
    return EventList(items=[EventDetail.of(row) for row in found])


@router.post("/{plant_id}/events", status_code=201)
def create_event(plant_id: PlantId, asked: NewEvent, parts: TheParts, owner: Submitter) -> EventDetail:
    """Note that the plant was watered, treated, repotted …"""
    values: dict[str, Any] = asked.model_dump(exclude={"at"})
    at = asked.at.timestamp() if asked.at else None
    return EventDetail.of(
        parts.store.write(
            lambda session: add_event(session, get_plant(session, plant_id, owner=owner), values, at),
        )
    )


@router.delete("/{plant_id}/events/{event_id}", status_code=204)
def delete_event(
    plant_id: PlantId, event_id: Annotated[str, Path(description="Id of an event.")], parts: TheParts, owner: Submitter
) -> None:
    """Forget an event."""
    which = uuid_of(event_id, "event", "GET /v1/plants/{id}/events")
    parts.store.write(lambda session: remove_event(session, get_plant(session, plant_id, owner=owner), which))


def look(parts: Parts, plant_id: str, owner: str) -> PlantDetail:
    """The plant as it is now. Raises `NotFound`."""
    with parts.store.read() as session:
        plant = get_plant(session, plant_id, owner=owner)
        tracks = [detail_of(plant, track) for track in list_tracks(session, plant)]
        due = next_due_of(session, [plant.key]).get(plant.key)
    return PlantDetail.of_tracks(plant, due, tracks)


def _exact(words: list[str] | tuple[()]) -> list[str]:
    """Exact states of the status words."""
    exact = {status: [state.value for state in states] for status, states in STATES_OF.items()}
    return [state for word in words for state in ([NEVER] if word == NEVER else exact[word])]  # type: ignore[index]
