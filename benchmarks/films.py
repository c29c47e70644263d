"""Films of the simulated palm: rendered once by Blender, kept under out/benchmarks/films, and the truth beside them.

The measurements of reconstruction and of motion tracking look at the same films.
"""

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from nerfmodal import io, simulate
from nerfmodal.simulate import Plant
from nerfmodal.spec import ImposedMode, ReconstructionSpec, RigSpec, ScanSpec, SimulationSource
from nerfmodal.types import Frame

FOLDER = Path("out/benchmarks/films")
GOLDEN = 137.5
"""Degrees of phase between leaves: no two leaves, and no two modes of a leaf, move in step."""
SAMPLES = 128
"""Rays per pixel: with few, a leaflet's edge jumps from one to the next where a camera's pixel would shade it."""


def palm_motion(amplitude: float) -> tuple[ImposedMode, ...]:
    """The paper's modes: 2, 5 and 10 Hz of every leaf and 1 Hz of the trunk; `amplitude` (m) is that of 2 Hz."""
    modes = [
        ImposedMode(
            organ=f"leaf_{leaf}",
            shape=shape,
            frequency_hz=frequency,
            damping_ratio=0.01,
            amplitude_m=share * amplitude,
            phase_deg=(GOLDEN * (3 * leaf + order)) % 360,
        )
        for leaf in range(5)
        for order, (shape, frequency, share) in enumerate(
            (("bending_1", 2.0, 1.0), ("bending_2", 5.0, 0.5), ("torsion_1", 10.0, 0.4))
        )
    ]
    trunk = ImposedMode(
        organ="trunk", shape="bending_1", frequency_hz=1.0, damping_ratio=0.01, amplitude_m=0.8 * amplitude
    )
    return (*modes, trunk)


def palm(
    amplitude: float = 0.05, *, views: int = 27, frames: int = 90, width: int = 200, height: int = 200
) -> ScanSpec:
    """The palm from 3 m: at 200 pixels a pixel's footprint is 14 mm."""
    return ScanSpec(
        name="palm",
        reconstruction=ReconstructionSpec(motion="refit"),
        source=SimulationSource(
            kind="simulation",
            frames=frames,
            frame_rate_hz=30,
            motion=palm_motion(amplitude),
            samples=SAMPLES,
            rig=RigSpec(cameras=views, radius_m=3.0, width_px=width, height_px=height),
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Film:
    """A specification and its pictures on disk."""

    spec: ScanSpec

    @property
    def source(self) -> SimulationSource:
        """What is simulated."""
        assert isinstance(self.spec.source, SimulationSource)
        return self.spec.source

    @property
    def plant(self) -> Plant:
        """The structure at rest."""
        return simulate.plant_of(self.source)

    @property
    def times(self) -> Float[np.ndarray, " frames"]:
        """Instants, seconds."""
        return simulate.frame_times(self.source)

    @property
    def footprint(self) -> float:
        """Size of a pixel at the rig's target, metres."""
        rig = self.source.rig
        side = max(rig.width_px, rig.height_px)
        return float(2 * rig.radius_m * np.tan(np.radians(rig.field_of_view_deg) / 2) / side)

    def frame(self, index: int) -> Frame:
        """Frame `index`, rendered unless it was before."""
        path = FOLDER / self._key() / f"frame_{index:04d}.zip"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            io.write_frame(path, simulate.render_frame(self.source, index, self.spec.seed, report=lambda _a, _b: None))
        return io.read_frame(path)

    def vertices(self, index: int) -> Float[np.ndarray, "vertices 3"]:
        """True positions of the plant's vertices in frame `index`, metres."""
        return simulate.vertices_at(self.plant, self.source, float(self.times[index]))

    def _key(self) -> str:
        return _digest(self.source.model_copy(update={"frames": 1}), self.spec.seed)


@cache
def _digest(source: SimulationSource, seed: int) -> str:
    """Of what is not the default: a film stays the same when the specification learns a new key."""
    said = json.dumps([source.model_dump(mode="json", exclude_defaults=True), seed], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:16]
