"""Files of a fleet: the long table, and a study as an RO-Crate."""

import tempfile
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse, Response, StreamingResponse
from scanjobs.fleet.exports import observations_csv, write_crate, write_parquet
from scanjobs.fleet.long_table import Extent
from starlette.background import BackgroundTask

from services.api.dependencies import Owner, TheParts
from services.api.routes.plants import PlantWord
from services.api.schemas_plants import Label, Moment

PARQUET = "application/vnd.apache.parquet"
ZIP = "application/zip"
BINARY = {"schema": {"type": "string", "format": "binary"}}
Study = Annotated[Label | None, Query(description="Of this study alone.")]
router = APIRouter(prefix="/v1/exports", tags=["exports"])


@router.get(
    "/observations",
    response_class=Response,
    responses={200: {"content": {"text/csv": {"schema": {"type": "string"}}, PARQUET: BINARY}}},
)
def observations(
    parts: TheParts,
    owner: Owner,
    format: Literal["csv", "parquet"] = "csv",  # noqa: A002
    study: Study = None,
    plant: Annotated[PlantWord | None, Query()] = None,
    since: Moment | None = None,
    until: Moment | None = None,
) -> Response:
    """One row for each plant × scan × track × trait, with factors and surroundings, ready for a mixed model."""
    extent = Extent(
        owner=owner,
        study=study,
        plant=plant,
        since=since.timestamp() if since else None,
        until=until.timestamp() if until else None,
    )
    if format == "csv":
        return StreamingResponse(
            observations_csv(parts.store, extent), media_type="text/csv", headers=_saved_as("observations.csv")
        )
    path = _temporary(".parquet")
    write_parquet(parts.store, extent, path)
    return _sent(path, PARQUET, "observations.parquet")


@router.get("/ro-crate", response_class=Response, responses={200: {"content": {ZIP: BINARY}}})
def crate(parts: TheParts, owner: Owner, study: Study = None) -> Response:
    """A study as an RO-Crate 1.1 in a zip archive: its tables, and ro-crate-metadata.json that describes them."""
    path = _temporary(".zip")
    write_crate(parts.store, Extent(owner=owner, study=study), path)
    return _sent(path, ZIP, "ro-crate.zip")


def _temporary(suffix: str) -> Path:
    with tempfile.NamedTemporaryFile(prefix="nerfmodal-", suffix=suffix, delete=False) as file:
        return Path(file.name)


def _sent(path: Path, media_type: str, name: str) -> FileResponse:
    return FileResponse(path, media_type=media_type, filename=name, background=BackgroundTask(path.unlink))


def _saved_as(name: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="{name}"'}
