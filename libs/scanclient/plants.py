"""`client.plants`: the fleet, of a `Client` (`Plants`) and of an `AsyncClient` (`AsyncPlants`)."""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import httpx

from scanclient import fleet_calls as calls
from scanclient.calls import Call
from scanclient.fleet_values import Alarm, Plant, Track

Words = Sequence[str]


class Plants:
    """The fleet of a `Client`.

    Examples
    --------
    >>> with Client("http://127.0.0.1:8000") as client:
    ...     for plant in client.plants.iterate(treatment=["drought"], sort="ratio"):
    ...         print(plant.id, plant.ratio)
    """

    def __init__(self, send: Callable[[Call], httpx.Response]) -> None:
        self._send = send

    def iterate(
        self,
        *,
        treatment: Words = (),
        tag: Words = (),
        study: Words = (),
        state: Words = (),
        alarm: bool | None = None,
        text: str | None = None,
        sort: str = "id",
    ) -> Iterator[Plant]:
        """Plants in the order of `sort` (a leading `-`: the largest first), page by page."""
        filters = plant_filters(treatment, tag, study, state, alarm, text)
        cursor: str | None = None
        while True:
            page = self._send(calls.list_plants(filters, sort=sort, cursor=cursor, limit=200)).json()
            yield from (Plant.parse(row) for row in page["items"])
            cursor = page["next_cursor"]
            if cursor is None:
                return

    def get(self, plant: str) -> Plant:
        """One plant. Raises `NotFound`."""
        return Plant.parse(self._send(calls.plant(plant)).json())

    def add(self, plant: str, values: Mapping[str, Any] | None = None) -> Plant:
        """Make a plant before its first scan. Raises `Conflict` where there is one."""
        return Plant.parse(self._send(calls.add_plant({"id": plant, **(values or {})})).json())

    def change(self, plant: str, changes: Mapping[str, Any]) -> Plant:
        """Change what is given. Raises `NotFound`, `InvalidRequest`."""
        return Plant.parse(self._send(calls.change_plant(plant, changes)).json())

    def history(
        self, plant: str, *, since: str | None = None, until: str | None = None, max_points: int = 500
    ) -> dict[str, Any]:
        """Tracks, surroundings, events, charts and alarms of a plant, as the service tells them."""
        call = calls.history(plant, since=since, until=until, max_points=max_points)
        document: dict[str, Any] = self._send(call).json()
        return document

    def tracks(self, plant: str) -> tuple[Track, ...]:
        """The tracks of a plant."""
        return tracks_of(self._send(calls.list_tracks(plant)))

    def correct(self, track: str, correction: Mapping[str, Any]) -> tuple[Track, ...]:
        """Merge, split, move, confirm, rename; the plant's tracks after it. Raises `Conflict`."""
        return tracks_of(self._send(calls.change_track(track, correction)))

    def alarms(self, *, state: Words = (), plant: str | None = None, kind: Words = ()) -> Iterator[Alarm]:
        """Alarms, the newest first."""
        filters = {"state": state, "plant": plant, "kind": kind}
        cursor: str | None = None
        while True:
            page = self._send(calls.list_alarms(filters, cursor=cursor, limit=200)).json()
            yield from (Alarm.parse(row) for row in page["items"])
            cursor = page["next_cursor"]
            if cursor is None:
                return

    def settle_alarm(self, alarm: str, state: str, note: str | None = None, *, new_reference: bool = False) -> Alarm:
        """Acknowledge or close an alarm. Raises `Conflict` where it is closed."""
        return Alarm.parse(self._send(calls.change_alarm(alarm, settled(state, note, new_reference))).json())

    def store_environment(self, table: str, plant: str | None = None) -> int:
        """Send a CSV table of surroundings; how many records were stored. Raises `InvalidRequest`, naming the line."""
        return int(self._send(calls.store_environment(plant, table)).json()["stored"])

    def add_event(self, plant: str, kind: str, *, note: str = "", at: str | None = None) -> None:
        """Note that something was done to a plant."""
        self._send(calls.add_event(plant, {"kind": kind, "note": note, "at": at}))

    def export(self, path: Path, *, study: str | None = None, plant: str | None = None) -> Path:
        """Write the long table (`.csv`, `.parquet`) or a study's RO-Crate (`.zip`), by the ending of `path`."""
        path.write_bytes(self._send(export_call(path, study, plant)).content)
        return path


class AsyncPlants:
    """The fleet of an `AsyncClient`: the same, awaited."""

    def __init__(self, send: Callable[[Call], Awaitable[httpx.Response]]) -> None:
        self._send = send

    async def iterate(
        self,
        *,
        treatment: Words = (),
        tag: Words = (),
        study: Words = (),
        state: Words = (),
        alarm: bool | None = None,
        text: str | None = None,
        sort: str = "id",
    ) -> AsyncIterator[Plant]:
        """Plants in the order of `sort`, page by page."""
        filters = plant_filters(treatment, tag, study, state, alarm, text)
        cursor: str | None = None
        while True:
            page = (await self._send(calls.list_plants(filters, sort=sort, cursor=cursor, limit=200))).json()
            for row in page["items"]:
                yield Plant.parse(row)
            cursor = page["next_cursor"]
            if cursor is None:
                return

    async def get(self, plant: str) -> Plant:
        """One plant. Raises `NotFound`."""
        return Plant.parse((await self._send(calls.plant(plant))).json())

    async def change(self, plant: str, changes: Mapping[str, Any]) -> Plant:
        """Change what is given. Raises `NotFound`, `InvalidRequest`."""
        return Plant.parse((await self._send(calls.change_plant(plant, changes))).json())

    async def history(
        self, plant: str, *, since: str | None = None, until: str | None = None, max_points: int = 500
    ) -> dict[str, Any]:
        """Tracks, surroundings, events, charts and alarms of a plant."""
        call = calls.history(plant, since=since, until=until, max_points=max_points)
        document: dict[str, Any] = (await self._send(call)).json()
        return document

    async def tracks(self, plant: str) -> tuple[Track, ...]:
        """The tracks of a plant."""
        return tracks_of(await self._send(calls.list_tracks(plant)))

    async def correct(self, track: str, correction: Mapping[str, Any]) -> tuple[Track, ...]:
        """Merge, split, move, confirm, rename; the plant's tracks after it. Raises `Conflict`."""
        return tracks_of(await self._send(calls.change_track(track, correction)))

    async def alarms(self, *, state: Words = (), plant: str | None = None, kind: Words = ()) -> AsyncIterator[Alarm]:
        """Alarms, the newest first."""
        filters = {"state": state, "plant": plant, "kind": kind}
        cursor: str | None = None
        while True:
            page = (await self._send(calls.list_alarms(filters, cursor=cursor, limit=200))).json()
            for row in page["items"]:
                yield Alarm.parse(row)
            cursor = page["next_cursor"]
            if cursor is None:
                return

    async def settle_alarm(
        self, alarm: str, state: str, note: str | None = None, *, new_reference: bool = False
    ) -> Alarm:
        """Acknowledge or close an alarm. Raises `Conflict` where it is closed."""
        return Alarm.parse((await self._send(calls.change_alarm(alarm, settled(state, note, new_reference)))).json())

    async def export(self, path: Path, *, study: str | None = None, plant: str | None = None) -> Path:
        """Write the long table or a study's RO-Crate, by the ending of `path`."""
        path.write_bytes((await self._send(export_call(path, study, plant))).content)
        return path


def plant_filters(
    treatment: Words, tag: Words, study: Words, state: Words, alarm: bool | None, text: str | None
) -> dict[str, str | Words | None]:
    """The filters of a list as they are sent."""
    said = None if alarm is None else str(alarm).lower()
    return {"treatment": treatment, "tag": tag, "study": study, "state": state, "alarm": said, "text": text}


def tracks_of(answer: httpx.Response) -> tuple[Track, ...]:
    """The tracks of an answer."""
    return tuple(Track.parse(row) for row in answer.json()["items"])


def settled(state: str, note: str | None, new_reference: bool) -> dict[str, Any]:
    """What is said of an alarm."""
    return {"state": state, "new_reference": new_reference} | ({"note": note} if note is not None else {})


def export_call(path: Path, study: str | None, plant: str | None) -> Call:
    """The request whose answer goes into `path`. Raises `ValueError` for another ending."""
    if path.suffix == ".zip":
        return calls.crate(study)
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"{path.name}: use a name that ends in .csv, .parquet or .zip")
    return calls.observations(path.suffix[1:], study=study, plant=plant)
