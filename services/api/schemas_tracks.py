"""What the API says of tracks, and how a person corrects one."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field, StringConstraints, model_validator
from scanjobs.fleet.tables import Plant, Track
from scanjobs.fleet.tracks import name_of, ratio_of

from services.api.schemas import instant
from services.api.schemas_access import Asked
from services.api.schemas_plants import Label, PlantDetail, TrackDetail

Ident = Annotated[str, StringConstraints(min_length=1, max_length=36, pattern=r"^[0-9a-fA-F-]+$")]
PlantDetail.model_rebuild()


class AtScan(Asked):
    """A scan of the plant."""

    scan: Ident


class Move(Asked):
    """A mode and the track that it belongs to: an id, `new`, or null for none."""

    scan: Ident
    organ: Label
    mode: Annotated[int, Field(ge=0, le=10_000)]
    to: Ident | Literal["new"] | None


class TrackChange(Asked):
    """One correction; it is kept whenever tracks are computed again."""

    name: Annotated[Label, Field(description="Empty: organ and number again.")] | None = None
    merge_into: Ident | None = Field(default=None, description="Every mode of this track goes to that one.")
    split_at: AtScan | None = Field(default=None, description="This scan and later ones become a new track.")
    move: Move | None = None
    confirm: AtScan | None = Field(default=None, description="The doubtful link to this scan is right.")
    release: Literal[True] | None = Field(default=None, description="Forget what was done by hand to this track.")

    @model_validator(mode="after")
    def _one_thing(self) -> "TrackChange":
        if len(self.model_fields_set) != 1 or getattr(self, next(iter(self.model_fields_set))) is None:
            raise ValueError("one of name, merge_into, split_at, move, confirm, release must be given")
        return self


class TrackList(BaseModel):
    """The tracks of a plant: living ones first, by frequency."""

    items: list[TrackDetail]


def detail_of(plant: Plant, row: Track) -> TrackDetail:
    """A track as the API tells it."""
    ratio, ratio_std = ratio_of(row)
    same = ("id", "number", "organ", "scans", "missed", "doubtful_links", "frequency_hz", "frequency_std_hz")
    more = ("damping_ratio", "reference_hz", "reference_std_hz", "by_hand")
    return TrackDetail.model_validate(
        {name: getattr(row, name) for name in (*same, *more)}
        | {
            "plant": plant.id,
            "name": name_of(row),
            "state": "active" if row.active else "ended",
            "born_at": instant(row.born_at),
            "last_seen_at": instant(row.last_seen_at),
            "ratio": ratio,
            "ratio_std": ratio_std,
        }
    )
