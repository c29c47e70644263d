"""What surrounded the plants: records as JSON or CSV, of one plant or of the whole house."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError
from scanjobs.fleet.environment import Record, read_csv, series_of, store_records
from scanjobs.fleet.plants import get_plant
from starlette.concurrency import run_in_threadpool

from services.api.dependencies import Owner, Parts, Submitter, TheParts
from services.api.errors import RequestRefused
from services.api.routes.plants import PlantId
from services.api.schemas_environment import EnvironmentRequest, HouseRequest, SeriesDetail, Stored, series_detail
from services.api.schemas_plants import Moment

CSV = "text/csv"
JSON = "application/json"
MOST_BYTES = 8 << 20
MOST_RECORDS = 100_000
TABLE = {"schema": {"type": "string", "example": "at,temperature_c,mass_g\n2026-01-01T06:00:00Z,21.5,812\n"}}
router = APIRouter(prefix="/v1", tags=["plants"])


def _takes(model: type[BaseModel]) -> dict[str, Any]:
    """The two bodies that an operation takes, as the OpenAPI document says them."""
    return {
        "requestBody": {
            "required": True,
            "content": {JSON: {"schema": model.model_json_schema(ref_template=INLINE)}, CSV: TABLE},
        }
    }


INLINE = "#/components/schemas/{model}"


@router.post("/plants/{plant_id}/environment", openapi_extra=_takes(EnvironmentRequest))
async def store_of_plant(plant_id: PlantId, request: Request, parts: TheParts, owner: Submitter) -> Stored:
    """Keep what surrounded a plant: JSON, or CSV with a column `at`; the same moment is written over."""
    records = await _records(request, EnvironmentRequest)
    return await run_in_threadpool(_store, parts, owner, records, plant_id)


@router.post("/environment", openapi_extra=_takes(HouseRequest))
async def store_of_house(request: Request, parts: TheParts, owner: Submitter) -> Stored:
    """Keep what surrounded all plants, or, with a column or key `plant`, several of them."""
    records = await _records(request, HouseRequest)
    return await run_in_threadpool(_store, parts, owner, records, None)


@router.get("/plants/{plant_id}/environment")
def show(
    plant_id: PlantId,
    parts: TheParts,
    owner: Owner,
    since: Moment | None = None,
    until: Moment | None = None,
    limit: Annotated[int, Query(ge=1, le=100_000, description="At most so many moments, the newest.")] = 5000,
) -> SeriesDetail:
    """What surrounded the plant, its own values before the house's."""
    bounds = since.timestamp() if since else None, until.timestamp() if until else None
    with parts.store.read() as session:
        plant = get_plant(session, plant_id, owner=owner)
        return series_detail(series_of(session, plant, since=bounds[0], until=bounds[1], limit=limit))


async def _records(request: Request, model: type[EnvironmentRequest] | type[HouseRequest]) -> tuple[Record, ...]:
    kind = request.headers.get("content-type", JSON).partition(";")[0].strip().lower()
    body = await request.body()
    if kind == CSV:
        try:
            records = read_csv(body.decode())
        except UnicodeDecodeError as error:
            raise RequestRefused(422, "INVALID_BODY", "The table is not UTF-8.", hint="Save it as UTF-8.") from error
    elif kind == JSON:
        records = _parsed(body, model)
    else:
        raise RequestRefused(415, "UNSUPPORTED_MEDIA_TYPE", "The body is no table.", hint=f"Send {JSON} or {CSV}.")
    if len(records) > MOST_RECORDS:
        raise RequestRefused(413, "TOO_LARGE", "There are too many records.", hint=f"Send {MOST_RECORDS} at a time.")
    return records


def _parsed(body: bytes, model: type[EnvironmentRequest] | type[HouseRequest]) -> tuple[Record, ...]:
    try:
        return model.model_validate_json(body).parsed()
    except ValidationError as error:
        rows = error.errors(include_url=False, include_input=False)
        raise RequestValidationError([{**row, "loc": ("body", *row["loc"])} for row in rows]) from error


def _store(parts: Parts, owner: str, records: tuple[Record, ...], plant_id: str | None) -> Stored:
    count = parts.store.write(lambda session: store_records(session, records, owner=owner, plant_id=plant_id))
    return Stored(stored=count)
