"""A whole scan: its source, how it is reconstructed and identified, and where it belongs."""

import hashlib
import json
from typing import Annotated, Literal

from pydantic import Field, model_validator

from nerfmodal.spec.capture import CaptureSource, CloudsSource
from nerfmodal.spec.parts import Box, Metres, Name, OrientedBox, Part, PositiveMetres
from nerfmodal.spec.simulation import SimulationSource

Source = Annotated[SimulationSource | CaptureSource | CloudsSource, Field(discriminator="kind")]


class ReconstructionSpec(Part):
    """How each frame's pictures become a point cloud."""

    field: Literal["grid", "mlp"] = "grid"
    motion: Literal["refit", "follow"] | None = None
    """`follow` moves the points of frame 0 through the pictures of every frame; `refit`, the paper's way, trains a
    field for every frame and fits its surfaces anew. By default `follow`; of the paper's field, `mlp`, `refit`."""
    region: Box | None = None
    """The box that is reconstructed finely; by default what all cameras look at."""
    ground_m: Metres | Literal["none"] | None = None
    """Height of the ground under the structure: what lies behind the structure is then known more sharply. By default a
    simulation's own; of a capture the plane on which its pictures agree, if there is one; `none`: no ground."""
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
    opacity_threshold: Annotated[float, Field(gt=0, lt=1)] = 0.3
    """Points whose ray is less opaque are discarded (eq 10)."""
    points: Annotated[int, Field(ge=100, le=10_000_000)] = 50_000
    """Points per cloud at the most."""

    @property
    def follows(self) -> bool:
        """Whether frames are followed, and not refitted."""
        return self.motion == "follow" or (self.motion is None and self.field == "grid")

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
