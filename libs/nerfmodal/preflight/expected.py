"""What is known before a scan runs: its record, how its cameras see, what set it in motion and which modes it has.

A simulation says all of it. A capture or a record of clouds says it once somebody has looked inside (`Seen`); its
modes are what the user expects of the structure.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from nerfmodal.preflight.answer import Excitation, Optics, RecordLimits
from nerfmodal.spec import HIGHEST_SHARE_OF_FRAME_RATE, RigSpec, ScanSpec, SimulationSource

NOISE_PER_GRAIN = 0.06
"""Standard deviation of a modal coordinate in one frame, in grains (`Optics`).

Measured: from the deviations that fifteen leaf modes of the palm came with (24 cameras of 224 × 320 at 3.2 m, a pixel
9.3 mm, voxels of 12.5 mm, 60 frames, Blender's pictures): 0.41 to 1.28 mm, root mean square 0.79 mm. See
docs/howto/preflight.md.
"""
MEASURED = "0.06 of the grain, measured on the simulated palm with 24 cameras"
GIVEN, CERTIFIED = "given", "the rig's certificate"
FEWEST_PERIODS = 2.0
LARGEST = 1e9
VOXELS_ALONG = 192
"""The grid field's finest voxel, where none is given: the region's largest side over this."""
REGION_PER_DISTANCE = {"simulation": 0.8, "capture": 1.8}
"""The region's largest side, where none is given, in distances of the cameras: a plant in the picture, or all of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedMode:
    """A mode that the structure is expected to have. `amplitude` is its envelope at the first frame, metres."""

    frequency: float
    damping_ratio: float
    amplitude: float
    organ: str | None = None
    shape: str | None = None
    pointer: str = ""

    @classmethod
    def parse(cls, text: str) -> "ExpectedMode":
        """A mode from 'HZ:DAMPING:MM'. Raises `ValueError` with what is wrong and the remedy."""
        parts = text.split(":")
        try:
            frequency, damping, millimetres = (float(part) for part in parts)
        except ValueError as error:
            raise ValueError(f"is no mode: '{text}'. Write HZ:DAMPING:MM, such as 4.8:0.01:12.") from error
        if not (0 < frequency < LARGEST and 0 <= damping < 1 and 0 < millimetres < LARGEST):
            raise ValueError(f"cannot be: '{text}'. Frequency and amplitude are positive, damping is 0 to 1.")
        return cls(frequency=frequency, damping_ratio=damping, amplitude=millimetres / 1000)


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What was found inside a capture or a record of clouds; of clouds the last three stay None."""

    frames: int
    frame_rate: float
    cameras: int | None = None
    distance: float | None = None
    footprint: float | None = None


def seen_in(spec: ScanSpec) -> Seen | None:
    """What a simulation's specification says of its record and rig; None of other sources."""
    source = spec.source
    if not isinstance(source, SimulationSource):
        return None
    return Seen(
        frames=source.frames,
        frame_rate=source.frame_rate_hz,
        cameras=source.rig.cameras,
        distance=source.rig.radius_m,
        footprint=footprint_of(source.rig),
    )


def footprint_of(rig: RigSpec) -> float:
    """Side of a pixel at the rig's target, metres."""
    side = max(rig.width_px, rig.height_px)
    return 2 * rig.radius_m * math.tan(math.radians(rig.field_of_view_deg) / 2) / side


def limits_of(seen: Seen) -> RecordLimits:
    """What the record's length and rate allow."""
    duration = seen.frames / seen.frame_rate
    return RecordLimits(
        frames=seen.frames,
        frame_rate_hz=seen.frame_rate,
        duration_s=duration,
        nyquist_hz=seen.frame_rate / 2,
        highest_hz=HIGHEST_SHARE_OF_FRAME_RATE * seen.frame_rate,
        lowest_hz=FEWEST_PERIODS / duration,
        bin_width_hz=1 / duration,
    )


def optics_of(spec: ScanSpec, seen: Seen, noise: float | None, noise_per_grain: float | None) -> Optics | None:
    """How finely the scan sees; None where there are no cameras.

    `noise` (m) goes before what a certificate says of the grain, and that before the measured constant.
    """
    if seen.cameras is None or seen.distance is None or seen.footprint is None:
        return None
    grain = max(seen.footprint, _voxel(spec, seen.distance))
    if not 0 < grain < LARGEST:
        return None
    return Optics(
        cameras=seen.cameras,
        distance_m=seen.distance,
        footprint_m=seen.footprint,
        grain_m=grain,
        noise_m=noise or (noise_per_grain or NOISE_PER_GRAIN) * grain,
        noise_basis=GIVEN if noise else CERTIFIED if noise_per_grain else MEASURED,
    )


def _voxel(spec: ScanSpec, distance: float) -> float:
    """Side of the finest voxel, metres; 0 of a field that has none."""
    box, field = spec.reconstruction.region, spec.reconstruction
    if field.field != "grid":
        return 0.0
    if field.voxel_m is not None:
        return field.voxel_m
    if box is not None:
        return max(high - low for low, high in zip(box.min_m, box.max_m, strict=True)) / VOXELS_ALONG
    return REGION_PER_DISTANCE.get(spec.source.kind, 1.0) * distance / VOXELS_ALONG


def excitation_of(spec: ScanSpec) -> Excitation:
    """What sets the structure in motion: what a simulation imposes, else what the user says, else a free decay."""
    if isinstance(spec.source, SimulationSource):
        kinds: dict[str, Excitation] = {"harmonic": "harmonic", "wind": "ambient"}
        return kinds.get(spec.source.excitation.kind, "free_decay")
    return "free_decay" if spec.identification.excitation == "auto" else spec.identification.excitation


def modes_of_spec(spec: ScanSpec, given: Sequence[ExpectedMode]) -> tuple[ExpectedMode, ...]:
    """The modes that a simulation imposes, then those that the user expects."""
    source = spec.source
    imposed = source.motion if isinstance(source, SimulationSource) else ()
    return (
        *(
            ExpectedMode(
                frequency=mode.frequency_hz,
                damping_ratio=mode.damping_ratio,
                amplitude=mode.amplitude_m,
                organ=mode.organ,
                shape=mode.shape,
                pointer=f"/source/motion/{index}",
            )
            for index, mode in enumerate(imposed)
        ),
        *given,
    )
