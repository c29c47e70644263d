"""A plant or a structure that Blender films: its sizes, how it moves, the rig and what its cameras do to pictures."""

from fnmatch import fnmatchcase
from typing import Annotated, Literal

from pydantic import Field, model_validator

from nerfmodal.spec.parts import Part, Point, PositiveMetres

HIGHEST_SHARE_OF_FRAME_RATE = 0.45
"""A mode above 0.45 frame rates cannot be told from its alias (Nyquist, with room for a line's width)."""


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


def modes_of(motion: tuple[ImposedMode, ...], organ: str) -> tuple[ImposedMode, ...]:
    """The imposed modes whose glob matches `organ`, in the order given."""
    return tuple(mode for mode in motion if fnmatchcase(organ, mode.organ))
