"""The requests of a fleet as values, as in `calls`."""

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from scanclient.calls import Call, Params

CSV = "text/csv"
Filters = Mapping[str, str | Sequence[str] | None]


def list_plants(filters: Filters, *, sort: str, cursor: str | None, limit: int) -> Call:
    params: Params = {"sort": sort, "limit": str(limit)}
    params |= {key: value if isinstance(value, str) else list(value) for key, value in filters.items() if value}
    if cursor:
        params["cursor"] = cursor
    return Call(method="GET", path="/v1/plants", params=params)


def plant(plant_id: str) -> Call:
    return Call(method="GET", path=_plant(plant_id))


def add_plant(body: Mapping[str, Any]) -> Call:
    return Call(method="POST", path="/v1/plants", body=dict(body), repeatable=False)


def change_plant(plant_id: str, changes: Mapping[str, Any]) -> Call:
    return Call(method="PATCH", path=_plant(plant_id), body=dict(changes))


def history(plant_id: str, *, since: str | None, until: str | None, max_points: int) -> Call:
    bounds = {"since": since, "until": until}
    params: Params = {key: value for key, value in bounds.items() if value}
    return Call(method="GET", path=_plant(plant_id, "history"), params=params | {"max_points": str(max_points)})


def list_tracks(plant_id: str) -> Call:
    return Call(method="GET", path="/v1/tracks", params={"plant": plant_id})


def change_track(track_id: str, correction: Mapping[str, Any]) -> Call:
    path = f"/v1/tracks/{quote(track_id, safe='')}"
    return Call(method="PATCH", path=path, body=dict(correction), repeatable=False)


def list_alarms(filters: Filters, *, cursor: str | None, limit: int) -> Call:
    params: Params = {"limit": str(limit)}
    params |= {key: value if isinstance(value, str) else list(value) for key, value in filters.items() if value}
    if cursor:
        params["cursor"] = cursor
    return Call(method="GET", path="/v1/alarms", params=params)


def change_alarm(alarm_id: str, changes: Mapping[str, Any]) -> Call:
    path = f"/v1/alarms/{quote(alarm_id, safe='')}"
    return Call(method="PATCH", path=path, body=dict(changes), repeatable=False)


def store_environment(plant_id: str | None, table: str) -> Call:
    """A CSV table of one plant's surroundings, or the house's; sending it twice is the same as once."""
    path = "/v1/environment" if plant_id is None else _plant(plant_id, "environment")
    return Call(method="POST", path=path, content=table.encode(), headers={"Content-Type": CSV})


def add_event(plant_id: str, event: Mapping[str, Any]) -> Call:
    return Call(method="POST", path=_plant(plant_id, "events"), body=dict(event), repeatable=False)


def observations(kind: str, *, study: str | None, plant: str | None) -> Call:
    filters = {"format": kind, "study": study, "plant": plant}
    return Call(method="GET", path="/v1/exports/observations", params={k: v for k, v in filters.items() if v})


def crate(study: str | None) -> Call:
    return Call(method="GET", path="/v1/exports/ro-crate", params={"study": study} if study else {})


def _plant(plant_id: str, *parts: str) -> str:
    return "/v1/plants/" + "/".join(quote(part, safe="") for part in (plant_id, *parts))
