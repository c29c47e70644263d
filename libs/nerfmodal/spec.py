"""What a user asks for: one frozen tree that is the HTTP body, the JSON column and the configuration.

SI units; a unit suffix stands on every key because types are lost in JSON. Unknown keys are refused.
"""

import hashlib
import json
from fnmatch import fnmatchcase
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Metres = Annotated[float, Field(allow_inf_nan=False)]
Point = tuple[Metres, Metres, Metres]
PositiveMetres = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]

HIGHEST_SHARE_OF_FRAME_RATE = 0.45
"""A mode above 0.45 frame rates cannot be told from its alias (Nyquist, with room for a line's width)."""


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


class RigSpec(Part):
    """Cameras on a semi-sphere around `target_m`, all looking at it."""

    cameras: Annotated[int, Field(ge=3, le=500)] = 24
    radius_m: PositiveMetres = 3.4
    target_m: Point = (0.0, 0.0, 1.5)
    lowest_deg: Annotated[float, Field(gt=-90, lt=90)] = 5.0
    highest_deg: Annotated[float, Field(gt=-90, lt=90)] = 70.0
    width_px: Annotated[int, Field(ge=16, le=7680)] = 224
    height_px: Annotated[int, Field(ge=16, le=7680)] = 320
    field_of_view_deg: Annotated[float, Field(gt=1, lt=150)] = 50.0
    """Along the longer side of the picture."""

    @model_validator(mode="after")
    def _elevations_are_ordered(self) -> "RigSpec":
        if self.highest_deg <= self.lowest_deg:
            raise ValueError("highest_deg must be larger than lowest_deg")
        return self


class ImposedMode(Part):
    """One mode imposed on the organs whose name matches `organ` (a glob: 'leaf_*', 'trunk')."""

    organ: Annotated[str, Field(min_length=1)]
    shape: Literal[
        "bending_1", "bending_2", "bending_3", "torsion_1", "torsion_2", "plate_1", "plate_2", "plate_3", "plate_4"
    ]
    frequency_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.01
    amplitude_m: PositiveMetres
    """Of the organ's largest point: what it means depends on the excitation."""
    phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Of decays and harmonic motion."""
    direction: Point | None = None
    """World direction of the motion; by default x for upright stems and z for all others."""


class FreeDecay(Part):
    """Every mode is let go at t = 0 and decays; `amplitude_m` is its envelope there."""

    kind: Literal["free_decay"] = "free_decay"


class Harmonic(Part):
    """Steady motion: every mode at its own frequency, or all at that of one force."""

    kind: Literal["harmonic"]
    frequency_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Of the force; `amplitude_m` is the motion at resonance. By default each mode is driven at its own frequency."""


class Wind(Part):
    """Steady random forcing, flat within a band; `amplitude_m` is the standard deviation that all of it would give."""

    kind: Literal["wind"]
    low_hz: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    high_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """By default half the frame rate."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

    @model_validator(mode="after")
    def _band_is_not_empty(self) -> "Wind":
        if self.high_hz is not None and self.high_hz <= self.low_hz:
            raise ValueError(f"high_hz = {self.high_hz:g} is not above low_hz; give a band, or leave high_hz out")
        return self


class AirPulse(Part):
    """One push, half a sine long; `amplitude_m` is the decay's that a blow of the same momentum would start."""

    kind: Literal["pulse"]
    at_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    duration_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.05


Excitation = Annotated[FreeDecay | Harmonic | Wind | AirPulse, Field(discriminator="kind")]


class PalmSpec(Part):
    """Sizes of the açai palm; the defaults are the paper's."""

    height_m: PositiveMetres = 2.59
    width_m: PositiveMetres = 1.61
    leaf_length_m: PositiveMetres = 0.98
    leaves: Annotated[int, Field(ge=1, le=24)] = 5
    leaflets_per_side: Annotated[int, Field(ge=4, le=80)] = 20
    leaflet_mass_kg: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.002
    """Of one leaflet: part of the modal masses in the truth."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Of the leaflets' lengths, tilts and greens."""


class SensorSpec(Part):
    """What real cameras do to pictures; by default nothing. Spreads are standard deviations."""

    full_well_e: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Electrons of a white pixel: light arrives in them (shot noise). By default it does not."""
    read_noise_e: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Electrons; needs `full_well_e`."""
    exposure_spread_ev: Annotated[float, Field(ge=0, le=4)] = 0.0
    """Between cameras, in stops."""
    white_balance_spread: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Between cameras: of the logarithm of the red and of the blue gain."""
    shutter_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """How long a picture is exposed: what moves is blurred. The frame's time is its middle."""
    rolling_shutter_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """From the first row of a picture to its last. The frame's time is that of the middle row."""
    jitter_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Of every camera's instant in every frame."""
    position_error_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Of the poses that are told, along each axis; the pictures are taken from the true ones."""
    rotation_error_deg: Annotated[float, Field(ge=0, le=30)] = 0.0
    """The same, about each axis of the camera."""
    focal_error: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """Of the told focal lengths, relative."""
    instants: Annotated[int, Field(ge=2, le=64)] = 5
    """Moments that an open shutter, and bands of rows that a rolling one, is made of."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

    @model_validator(mode="after")
    def _read_noise_has_electrons(self) -> "SensorSpec":
        if self.read_noise_e > 0 and self.full_well_e is None:
            raise ValueError("read_noise_e = electrons of no well; set full_well_e, for instance 10000")
        return self


class SimulationSource(Part):
    """A plant or a structure that Blender films."""

    kind: Literal["simulation"]
    structure: Literal["acai", "herb", "tree", "plate", "tower"] = "acai"
    palm: PalmSpec = PalmSpec()
    """Of `acai` alone."""
    frames: Annotated[int, Field(ge=1, le=100_000)]
    frame_rate_hz: Annotated[float, Field(ge=1e-6, le=100_000)]
    motion: tuple[ImposedMode, ...]
    excitation: Excitation = FreeDecay()
    kinematics: Literal["linear", "rotation"] = "linear"
    """`linear` shifts every point along the direction (the paper's z offset); `rotation` turns slender members and
    keeps their length, so that a large swing has harmonics."""
    coupled: bool = False
    """Whether leaves and branches ride on what they grow from; the paper imposes them independently."""
    rig: RigSpec = RigSpec()
    renderer: Literal["blender", "preview"] = "blender"
    samples: Annotated[int, Field(ge=1, le=4096)] = 4
    """Rays per pixel."""
    sensor: SensorSpec = SensorSpec()
    depth_maps: bool = False
    """Whether the truth has a depth map of every view: `depth_0000.npz` beside every frame."""

    @model_validator(mode="after")
    def _no_mode_aliases(self) -> "SimulationSource":
        limit = HIGHEST_SHARE_OF_FRAME_RATE * self.frame_rate_hz
        for index, mode in enumerate(self.motion):
            if mode.frequency_hz > limit:
                raise ValueError(
                    f"motion[{index}].frequency_hz = {mode.frequency_hz:g} Hz aliases at frame_rate_hz = "
                    f"{self.frame_rate_hz:g}: only modes up to {limit:g} Hz can be told apart; "
                    f"use frame_rate_hz >= {mode.frequency_hz / HIGHEST_SHARE_OF_FRAME_RATE:.4g}"
                )
        return self

    @model_validator(mode="after")
    def _driven_modes_are_damped(self) -> "SimulationSource":
        force = self.excitation
        driven = isinstance(force, Wind) or (isinstance(force, Harmonic) and force.frequency_hz is not None)
        for index, mode in enumerate(self.motion):
            if driven and mode.damping_ratio == 0:
                raise ValueError(f"motion[{index}].damping_ratio = 0 never settles under a force; give one above 0")
        return self


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


Source = Annotated[SimulationSource | CaptureSource | CloudsSource, Field(discriminator="kind")]


class ReconstructionSpec(Part):
    """How each frame's pictures become a point cloud."""

    field: Literal["grid", "mlp"] = "grid"
    motion: Literal["refit", "follow"] = "refit"
    """`refit` trains a field for every frame and fits its surfaces anew; `follow` moves the points of frame 0."""
    region: Box | None = None
    """The box that is reconstructed finely; by default what all cameras look at."""
    voxel_m: PositiveMetres | None = None
    """Side of the finest voxel of the grid field; by default the region's largest side / 192."""
    iterations: Annotated[int, Field(ge=1)] = 600
    """Of frame 0, up to the checkpoint that all frames start from."""
    fine_tune_iterations: Annotated[int, Field(ge=1)] = 240
    """Of every frame, from the frame-0 checkpoint."""
    settled_m: PositiveMetres | None = None
    """The paper's field stops early when the moved surface changes by less between two looks, of twenty a training."""
    rays_per_batch: Annotated[int, Field(ge=16)] = 4096
    learning_rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """By default the field's own."""
    mlp_width: Annotated[int, Field(ge=8, le=1024)] = 256
    coarse_samples: Annotated[int, Field(ge=2)] = 64
    fine_samples: Annotated[int, Field(ge=2)] = 192
    opacity_threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Points whose ray is less opaque are discarded (eq 10)."""
    points: Annotated[int, Field(ge=100, le=10_000_000)] = 50_000
    """Points per cloud at the most."""

    @model_validator(mode="after")
    def _backgrounds_are_known(self) -> "ReconstructionSpec":
        if self.motion == "follow" and self.field != "grid":
            raise ValueError("motion: follow needs field: grid, which learns what stands still behind the structure")
        return self


class OrganSpec(Part):
    """A leaf (a sheet's surface) or a branch (cylinder) and where its points are."""

    name: Name
    region: OrientedBox | Literal["auto"] | None = None
    """A box; 'auto' finds the organ, the largest of its kind that is left; by default the whole cloud."""
    surface: Literal["polynomial", "tensor", "spline", "cylinder"] = "polynomial"
    degree: Annotated[int, Field(ge=1, le=9)] = 5
    """Total degree of the polynomial ('poly55' of the paper is 5), degree along each axis of the tensor, pieces
    along the spline, degree of the cylinder's centreline (4 at most)."""
    sensors: Annotated[int, Field(ge=4, le=1_000_000)] = 1000


class IdentificationSpec(Part):
    """How the displacement matrix becomes modes."""

    method: Literal["damped_sinusoids", "complexity_pursuit"] = "damped_sinusoids"
    reference: Literal["mean", "first", "previous"] = "mean"
    """What the displacement is measured from (eq 11)."""
    components: Annotated[int, Field(ge=1, le=50)] | None = None
    """Principal components kept (eq 12; the paper: 3); by default those above the noise."""
    max_modes: Annotated[int, Field(ge=1, le=20)] = 8
    excitation: Literal["auto", "free_decay", "ambient", "harmonic"] = "auto"


class PlantSpec(Part):
    """Which plant of the fleet this is."""

    id: Name
    position: str | None = None
    treatment: str | None = None


class ScanSpec(Part):
    """A whole scan: where pictures or clouds come from and what is done with them."""

    name: Name = "scan"
    source: Source
    reconstruction: ReconstructionSpec = ReconstructionSpec()
    organs: tuple[OrganSpec, ...] | Literal["auto"] = ()
    """'auto' finds them in the clouds; so does nothing, except that a simulation knows its own."""
    identification: IdentificationSpec = IdentificationSpec()
    plant: PlantSpec | None = None
    rig_certificate: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    """Id of the certificate of the cameras that filmed it (`nerfmodal certify`); it stands in the result."""
    tags: tuple[Name, ...] = ()
    max_failed_frames: Annotated[int, Field(ge=0)] = 0
    partial_every: Annotated[int, Field(ge=16)] | None = None
    """The modes so far are told after every so many frames."""
    deadline_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """From its submission; a scan that has not ended by then has failed, and a retry keeps what it has computed."""
    step_limit_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """A step that computes for longer has failed; by default the service's limit."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

    @model_validator(mode="after")
    def _organ_names_differ(self) -> "ScanSpec":
        names = [organ.name for organ in self.organs if isinstance(organ, OrganSpec)]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f"organs: two organs are called {sorted(twice)}; give each its own name")
        return self

    def digest(self) -> str:
        """SHA-256 of the specification in canonical JSON: equal scans have equal digests."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def modes_of(motion: tuple[ImposedMode, ...], organ: str) -> tuple[ImposedMode, ...]:
    """The imposed modes whose glob matches `organ`, in the order given."""
    return tuple(mode for mode in motion if fnmatchcase(organ, mode.organ))
