"""What the parts of a specification are made of: numbers with bounds, points and boxes."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Metres = Annotated[float, Field(allow_inf_nan=False)]
Point = tuple[Metres, Metres, Metres]
PositiveMetres = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


class Part(BaseModel):
    """A part of the specification: frozen, and unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Box(Part):
    """An axis-aligned box of the world, metres."""

    min_m: Point
    max_m: Point

    @model_validator(mode="after")
    def _has_volume(self) -> "Box":
        if any(high <= low for low, high in zip(self.min_m, self.max_m, strict=True)):
            raise ValueError("every component of max_m must be larger than that of min_m")
        return self


class OrientedBox(Part):
    """A box turned about the vertical, then pitched: its x axis runs along the organ.

    `yaw_deg` turns +x towards +y; `pitch_deg` raises (+) or lowers (-) the far end.
    """

    center_m: Point
    size_m: tuple[PositiveMetres, PositiveMetres, PositiveMetres]
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
