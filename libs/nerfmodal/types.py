"""The values that travel between the stages: frozen, SI units, shapes checked in test runs.

World: right-handed, metres, +z up. Cameras: OpenGL (+x right, +y up, looking along -z). Pixel (0, 0) is the
centre of the first pixel plus one half: its centre lies at (0.5, 0.5).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

DistortionModel = Literal["pinhole", "opencv", "fisheye"]
FieldKind = Literal["grid", "mlp", "moved"]
"""`moved` is no field: the points of frame 0 where a frame shows them."""
SurfaceKind = Literal["polynomial", "tensor", "spline", "cylinder"]
Look = Callable[[Int[np.ndarray, "rays 3"]], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
"""Pixels (camera, row, column) to colours (rays, 3), opacities, distances and their spreads (rays,), metres."""


class Outcome(Enum):
    """How a numerical step ended; the value is the message the user reads."""

    OK = "The result can be used."
    TOO_FEW_FRAMES = "Fewer than 16 usable frames: no modes can be identified; record for longer."
    NO_MOTION = "No vibration stands out of the noise: no modes."
    NOT_CONVERGED = "The iteration did not converge; the result is the best found."
    EMPTY_FIELD = "The field never became opaque: no points; check the poses and the region."
    NOT_FOLLOWED = "An organ could not be followed: its points stand where frame 0 had them, without a precision."
    FEW_POINTS = "Fewer points than asked were opaque enough; all of them were kept."


class Verdict(Enum):
    """What the product says of a mode."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"
    REJECTED = "rejected"


class Reason(Enum):
    """Why a mode is doubtful or rejected; the value says it in words."""

    RECORD_TOO_SHORT = "The record holds fewer than two periods of the mode."
    ALIAS_SUSPECT = "The frequency is above 0.45 of the frame rate: it may be an alias."
    NEGATIVE_DAMPING = "The estimated damping is negative beyond its uncertainty."
    LOW_MPC = "The shape is complex: its points do not move in phase."
    METHODS_DISAGREE = "The estimators do not agree on frequency or shape."
    HARMONIC = "The frequency is a combination of stronger modes."
    FIT_RESIDUAL_HIGH = "The mode stands little above the residual of the fit."
    DRIFT = "The residual is correlated from frame to frame: intervals are optimistic."
    WEAK = "The mode has less than two per cent of the strongest one, or a tenth where no other method finds it."


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """One calibrated camera. Lengths in pixels, the pose in metres.

    `distortion` is (k1, k2, k3, k4, p1, p2); a pinhole has zeros.
    """

    name: str
    width: int
    height: int
    focal_x: float
    focal_y: float
    center_x: float
    center_y: float
    camera_to_world: Float[np.ndarray, "4 4"]
    model: DistortionModel = "pinhole"
    distortion: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """The cameras of a capture; they stand still through the record."""

    cameras: tuple[Camera, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One instant, by the cameras that saw it: one that lost its picture is not in `rig`. All pictures have one size.

    `counts` marks the pixels that say something (None: all); `region` is the box, lowest and highest corner in
    metres, that the capture found to move (None: not looked for).
    """

    index: int
    time: float
    images: UInt8[np.ndarray, "cameras height width 3"]
    rig: Rig
    counts: Bool[np.ndarray, "cameras height width"] | None = None
    region: Float[np.ndarray, "2 3"] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """A trained field. `state` holds named arrays only, so that it is stored without pickle.

    `parent` is the frame whose checkpoint this one was tuned from (None for the first).
    """

    field: FieldKind
    frame_index: int
    step: int
    parent: int | None
    state: dict[str, np.ndarray]
    psnr: float
    held_out_psnr: float | None = None
    device: str = ""
    """What it was trained on, and the precision of products there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointCloud:
    """Points on the surface of the structure at one instant; colours in [0, 1].

    `stds` are given where points are material, point i the same place of the structure in every cloud: standard
    deviation of its displacement along an axis, metres; infinite where it was lost.
    """

    points: Float[np.ndarray, "points 3"]
    colors: Float[np.ndarray, "points 3"]
    time: float
    outcome: Outcome = Outcome.OK
    device: str = ""
    """What its field was trained on; empty for clouds of other sensors."""
    stds: Float[np.ndarray, " points"] | None = None

    def part(self, chosen: Bool[np.ndarray, " points"]) -> "PointCloud":
        """The cloud of the chosen points alone."""
        stds = None if self.stds is None else self.stds[chosen]
        return replace(self, points=self.points[chosen], colors=self.colors[chosen], stds=stds)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorGrid:
    """Virtual sensors of one organ at rest, metres, world frame."""

    organ: str
    positions: Float[np.ndarray, "sensors 3"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplacementMatrix:
    """Displacement of every sensor in every frame, metres, as its factors D = C Bᵀ.

    `coefficients` C are NaN in lost frames; `basis` B has a row for every degree of freedom (sensor 0 axis 0,
    sensor 0 axis 1, …). So 10,000 frames of 99,990 sensors take 20 MB, and D itself, 8 GB, is never needed.
    `directions` are the unit vectors (world) that is measured along: the normal of a leaf's plane, the two
    directions across a trunk, or x, y, z. `times` are the frames' instants in seconds.
    """

    coefficients: Float[np.ndarray, "frames terms"]
    basis: Float[np.ndarray, "dofs terms"]
    directions: Float[np.ndarray, "axes 3"]
    times: Float[np.ndarray, " frames"]
    frame_rate: float
    sensors: SensorGrid
    valid: Bool[np.ndarray, " frames"]

    @classmethod
    def of_values(
        cls,
        values: Float[np.ndarray, "frames sensors axes"],
        *,
        directions: Float[np.ndarray, "axes 3"],
        times: Float[np.ndarray, " frames"],
        frame_rate: float,
        sensors: SensorGrid,
        valid: Bool[np.ndarray, " frames"],
    ) -> "DisplacementMatrix":
        """The matrix of measured values (NaN in lost frames), with factors that give exactly these back."""
        flat = values.reshape(len(values), -1)
        if flat.shape[1] <= len(flat):
            coefficients, basis = np.where(valid[:, None], flat, np.nan), np.eye(flat.shape[1])
        else:
            seen = np.flatnonzero(valid)
            coefficients, basis = np.full((len(flat), len(seen)), np.nan), flat[seen].T
            coefficients[seen] = np.eye(len(seen))
        return cls(
            coefficients=coefficients,
            basis=basis,
            directions=directions,
            times=times,
            frame_rate=frame_rate,
            sensors=sensors,
            valid=valid,
        )

    @property
    def values(self) -> Float[np.ndarray, "frames sensors axes"]:
        """D in full: frames x sensors x axes numbers of eight bytes. See `of_sensors` and `of_frames` for parts."""
        return self.of_sensors(0, len(self.sensors.positions))

    def of_sensors(self, first: int, end: int) -> Float[np.ndarray, "frames some axes"]:
        """D at the sensors `first` to `end` - 1: long records of many sensors are written piece by piece."""
        axes = len(self.directions)
        part = self.basis[first * axes : end * axes]
        return np.asarray((self.coefficients @ part.T).reshape(len(self.times), -1, axes))

    def of_frames(self, first: int, end: int) -> Float[np.ndarray, "some sensors axes"]:
        """D in the frames `first` to `end` - 1."""
        rows = self.coefficients[first:end] @ self.basis.T
        return np.asarray(rows.reshape(len(rows), -1, len(self.directions)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """PCA of the displacement matrix (eq 12): D = scores @ components.T + mean; dofs = sensors * axes."""

    components: Float[np.ndarray, "dofs rank"]
    scores: Float[np.ndarray, "frames rank"]
    singular_values: Float[np.ndarray, " all"]
    mean: Float[np.ndarray, " dofs"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """Separated modal coordinates (eq 13): scores = coordinates @ mixing."""

    coordinates: Float[np.ndarray, "frames modes"]
    mixing: Float[np.ndarray, "modes rank"]
    outcome: Outcome = Outcome.OK


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeQuality:
    """What is known of one mode beside its numbers.

    `agreeing` are the other methods that see it, `mac_between_methods` the best MAC with them: None where none does.
    """

    energy_share: float
    mpc: float
    mac_between_methods: float | None
    verdict: Verdict
    reasons: tuple[Reason, ...] = ()
    agreeing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalModel:
    """Modes of one organ, sorted by frequency.

    `frequencies` are undamped natural frequencies in Hz, `damping_ratios` are in 0-1. Shapes are real, normalised
    to a largest component of 1, positive there (`unit_max`), so that `coordinates` are in metres.
    """

    frequencies: Float[np.ndarray, " modes"]
    frequency_stds: Float[np.ndarray, " modes"]
    damping_ratios: Float[np.ndarray, " modes"]
    damping_stds: Float[np.ndarray, " modes"]
    mode_shapes: Float[np.ndarray, "sensors axes modes"]
    coordinates: Float[np.ndarray, "frames modes"]
    quality: tuple[ModeQuality, ...]
    outcome: Outcome = Outcome.OK


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagram:
    """A stabilisation diagram: the poles of models of rising order; stable ones are found again at the next order."""

    orders: Int[np.ndarray, " poles"]
    frequencies: Float[np.ndarray, " poles"]
    damping_ratios: Float[np.ndarray, " poles"]
    stable: Bool[np.ndarray, " poles"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Opinion:
    """What one method says of an organ: kept beside the answer, so that no number stands without its picture.

    `diagram` is that of a method that reads its modes from models of rising order.
    """

    method: str
    frequencies: Float[np.ndarray, " modes"]
    damping_ratios: Float[np.ndarray, " modes"]
    mode_shapes: Float[np.ndarray, "sensors axes modes"]
    coordinates: Float[np.ndarray, "frames modes"]
    diagram: Diagram | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OrganResult:
    """Everything identified of one organ."""

    organ: str
    surface: SurfaceKind
    displacement: DisplacementMatrix
    reduction: Reduction | None
    model: ModalModel
    opinions: tuple[Opinion, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a result comes from; `rig_certificate` is the id of its cameras' certificate, where they have one."""

    package_version: str
    spec_digest: str
    seed: int
    device: str
    started: str
    finished: str
    rig_certificate: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureMode:
    """One motion of several organs: mode `modes[k]` of organ `organs[k]`, strongest first.

    `amplitudes` are signed and relative to the largest, which is 1; `phases` (radians) are against the first organ,
    near 0 or pi; `coherences` say how constant they are (1: wholly). `shape` is the motion at `positions`, the sensors
    of all these organs at rest (world, metres), for a coordinate of 1; `coordinates` are in metres.
    """

    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_std: float
    organs: tuple[str, ...]
    modes: tuple[int, ...]
    amplitudes: Float[np.ndarray, " members"]
    phases: Float[np.ndarray, " members"]
    coherences: Float[np.ndarray, " members"]
    coordinates: Float[np.ndarray, " frames"]
    positions: Float[np.ndarray, "sensors 3"]
    shape: Float[np.ndarray, "sensors 3"]
    verdict: Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanResult:
    """All organs of a scan, and the motions that organs share."""

    organs: tuple[OrganResult, ...]
    times: Float[np.ndarray, " frames"]
    frame_rate: float
    excitation: str
    provenance: Provenance
    outcome: Outcome = Outcome.OK
    structure: tuple[StructureMode, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueMode:
    """An imposed mode of one organ: the truth that only comparison code reads.

    `points` are rest positions on the organ (metres, world) and `shape` is the displacement there for a modal
    coordinate of 1 (largest length 1); `coordinates` is that coordinate in every frame, metres.
    """

    organ: str
    name: str
    frequency: float
    damping_ratio: float
    points: Float[np.ndarray, "points 3"]
    shape: Float[np.ndarray, "points 3"]
    coordinates: Float[np.ndarray, " frames"]

    @property
    def damped_frequency(self) -> float:
        """Hz."""
        return float(self.frequency * np.sqrt(1 - self.damping_ratio**2))


@dataclass(frozen=True, slots=True, kw_only=True)
class Mesh:
    """A triangle mesh with a colour per vertex and the organ each vertex belongs to (index into `organs`)."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    colors: Float[np.ndarray, "vertices 3"]
    organ: Int[np.ndarray, " vertices"] = field(repr=False)
    organs: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueScene:
    """What a simulation knows beside its modes and where its vertices went; only comparison code reads it.

    `mesh` is at rest; `rig` has the poses that the pictures were taken from, whatever the frames say; `modal_masses`
    (kg) belong to the modes.
    """

    mesh: Mesh
    times: Float[np.ndarray, " frames"]
    rig: Rig
    modal_masses: Float[np.ndarray, " modes"]
