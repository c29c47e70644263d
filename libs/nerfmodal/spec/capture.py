"""What was recorded of a real structure: pictures, videos or point clouds."""

from typing import Annotated, Literal

from pydantic import Field

from nerfmodal.spec.parts import Part, PositiveMetres


class CameraDistance(Part):
    """Two cameras and the metres between their lenses."""

    kind: Literal["cameras"]
    between: tuple[str, str]
    distance_m: PositiveMetres


class PointDistance(Part):
    """Two points that frame 0 shows, each by its pixels in at least two cameras, and the metres between them."""

    kind: Literal["points"]
    first_px: dict[str, tuple[float, float]]
    second_px: dict[str, tuple[float, float]]
    distance_m: PositiveMetres


class Checkerboard(Part):
    """A checkerboard in frame 0: its inner corners and the side of a square. It also says where up is."""

    kind: Literal["checkerboard"]
    columns: Annotated[int, Field(ge=3, le=100)]
    rows: Annotated[int, Field(ge=3, le=100)]
    square_m: PositiveMetres
    lies_flat: bool = True
    """Whether its normal is the world's +z, and its first corner the origin; else it gives metres alone."""


Scale = Annotated[CameraDistance | PointDistance | Checkerboard, Field(discriminator="kind")]


class CaptureSource(Part):
    """Pictures or videos of a real structure, with solved cameras or without."""

    kind: Literal["capture"]
    path: Annotated[str, Field(min_length=1)]
    format: Literal["auto", "transforms", "dnerf", "dynerf", "colmap", "videos", "unsolved"] = "auto"
    """How the folder says where its cameras stand; `auto` looks at what is in it."""
    frame_rate_hz: Annotated[float, Field(ge=1e-6, le=1_000_000, allow_inf_nan=False)] | None = None
    """Of captures that do not tell it themselves."""
    synchronise: Literal["auto", "clocks", "audio", "flash", "motion"] = "auto"
    """How videos that started at different moments are brought together; `clocks` trusts their time stamps."""
    offsets_s: dict[str, Annotated[float, Field(allow_inf_nan=False)]] | None = None
    """By camera: the time on its own clock at which the record begins. Given, nothing is searched for."""
    scale: Scale | None = None
    """What brings cameras that were solved in an unknown unit to metres."""
    one_lens: bool = False
    """Cameras to be solved are equal: one set of intrinsics is solved for all of them."""
    region: Literal["seen", "moving"] = "seen"
    """The box to reconstruct, where none is given: what all cameras look at, or the part of it that moves."""
    hold_out_every: Annotated[int, Field(ge=2)] | None = None
    """Every n-th view is not trained on and measures the PSNR."""
    downscale: Annotated[int, Field(ge=1, le=64)] = 1


class CloudsSource(Part):
    """Point clouds of any sensor; nothing is filmed or trained."""

    kind: Literal["clouds"]
    path: Annotated[str, Field(min_length=1)]
    frame_rate_hz: Annotated[float, Field(ge=1e-6, allow_inf_nan=False)] | None = None
    """Goes before what the files say; needed where they say nothing."""
    unit: Literal["km", "m", "dm", "cm", "mm", "um", "in", "ft"] | None = None
    """Unit of length of the points; by default what the files say, or metres."""
