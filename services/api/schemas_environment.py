"""What the API says of plants' surroundings."""

from datetime import datetime
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, StringConstraints
from scanjobs.fleet.environment import COLUMNS, FREE_NAME, Record, Series

from services.api.schemas import instant
from services.api.schemas_access import Asked
from services.api.schemas_plants import Moment, Number, PlantName

FreeName = Annotated[str, StringConstraints(pattern=f"^{FREE_NAME.pattern}$")]


class EnvironmentRecord(Asked):
    """The values of a moment; what is not given is not known."""

    at: Moment
    temperature_c: Number | None = None
    humidity_percent: Number | None = None
    light_umol_m2_s: Number | None = None
    soil_water_percent: Number | None = None
    mass_g: Number | None = None
    values: Annotated[dict[FreeName, Number], Field(max_length=32)] = Field(
        default={}, description="Columns of one's own."
    )

    def parsed(self) -> Record:
        """As it is stored."""
        given = {name: value for name in COLUMNS if (value := getattr(self, name)) is not None}
        return Record(at=self.at.timestamp(), values=given | self.values, plant=getattr(self, "plant", None))


class HouseRecord(EnvironmentRecord):
    """The same of the whole house, or of the plant it names."""

    plant: PlantName | None = None


class EnvironmentRequest(Asked):
    """Records of one plant."""

    records: Annotated[list[EnvironmentRecord], Field(max_length=100_000)]

    def parsed(self) -> tuple[Record, ...]:
        """As they are stored."""
        return tuple(record.parsed() for record in self.records)


class HouseRequest(Asked):
    """Records of the whole house, or of several plants."""

    records: Annotated[list[HouseRecord], Field(max_length=100_000)]

    def parsed(self) -> tuple[Record, ...]:
        """As they are stored."""
        return tuple(record.parsed() for record in self.records)


class Stored(BaseModel):
    """How many records were stored."""

    stored: int


class SeriesDetail(BaseModel):
    """Columns over time, null where nothing is known."""

    columns: list[str]
    at: list[datetime]
    values: dict[str, list[float | None]]


def series_detail(series: Series) -> SeriesDetail:
    """A series as the API tells it."""
    return SeriesDetail.model_validate(
        {
            "columns": list(series.values),
            "at": [instant(float(at)) for at in series.at],
            "values": {name: column_of(values) for name, values in series.values.items()},
        }
    )


def column_of(values: np.ndarray) -> list[Any]:
    """Numbers, and None where one is not known."""
    return [float(value) if np.isfinite(value) else None for value in values]
