"""A simulated scan with every file, for the demonstration: a palm's points are drawn in motion, and its modes are then
identified as those of any record of clouds are. What was imposed goes beside them as the truth.
"""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from nerfmodal import io, pipeline, simulate
from nerfmodal.progress import Progress
from nerfmodal.simulate.light import to_srgb
from nerfmodal.spec import CloudsSource, ImposedMode, PlantSpec, ScanSpec, SimulationSource
from nerfmodal.types import Mesh, PointCloud
from scanjobs.fleet.seeding_files import Drawn, Pot

SIMULATED: Final = "simulated"
"""Tag that tells such a scan from a measured one; the page shows the truth beside its modes."""
FRAMES: Final = 90
FRAME_RATE_HZ: Final = 30.0
POINTS, SHOWN_POINTS = 6_000, 30_000
"""Of a cloud that modes are read from, and of the first one as it is kept and shown."""
NOISE_M: Final = 0.001
IMPOSED: Final = (("leaf_0", "bending_1", 0.04), ("leaf_0", "bending_2", 0.012), ("trunk", "bending_1", 0.03))
"""Organ, shape and amplitude (m) of a pot's three modes, in their order."""


def draw_scan(pot: Pot, folder: Path) -> Drawn:
    """The newest scan of a pot: drawn, identified and published under `folder`."""
    source, rng = _source(pot), np.random.default_rng([pot.number, 9])
    spec = _spec(pot, source)
    first, clouds = _write_clouds(source, folder / "clouds.npz", rng)
    there = spec.model_copy(update={"source": CloudsSource(kind="clouds", path=str(clouds))})
    result = pipeline.identify(there, tuple(pipeline.read_clouds(there)), report=_silently)
    files = pipeline.publish(spec, result, None, first, folder / "out")
    io.write_cloud(folder / "frame_0000.ply", first)
    io.write_truth(folder / "truth.npz", simulate.true_modes(source, simulate.frame_times(source)))
    return Drawn(
        spec=spec.model_dump(mode="json"),
        frames=FRAMES,
        results={path.relative_to(folder / "out").as_posix(): path for path in files},
        beside={"cloud": folder / "frame_0000.ply", "truth": folder / "truth.npz"},
    )


def _source(pot: Pot) -> SimulationSource:
    """The palm with the modes that the pot has at its last scan."""
    of_modes = zip(IMPOSED, pot.life.frequencies[-1], pot.life.damping_ratios[-1], strict=True)
    motion = tuple(
        ImposedMode(organ=organ, shape=shape, frequency_hz=frequency, damping_ratio=damping, amplitude_m=amplitude)
        for (organ, shape, amplitude), frequency, damping in of_modes
    )
    return SimulationSource(kind="simulation", frames=FRAMES, frame_rate_hz=FRAME_RATE_HZ, motion=motion)


def _spec(pot: Pot, source: SimulationSource) -> ScanSpec:
    organs = {organ for organ, _, _ in IMPOSED}
    return ScanSpec(
        name=pot.id,
        source=CloudsSource(kind="clouds", path="demo-fleet"),
        organs=tuple(organ for organ in simulate.default_organs(source) if organ.name in organs),
        plant=PlantSpec(id=pot.id, treatment=pot.treatment),
        tags=("demo-fleet", SIMULATED),
        seed=pot.number,
    )


def _write_clouds(source: SimulationSource, path: Path, rng: np.random.Generator) -> tuple[PointCloud, Path]:
    """One cloud a frame, each of other points of the surfaces; the first one, denser, and the file of all."""
    mesh = simulate.plant_of(source).mesh
    clouds = {
        f"frame_{k:04d}": _drawn(mesh, positions, POINTS, rng)[0]
        for k, positions in enumerate(simulate.true_positions(source))
    }
    np.savez(path, frame_rate_hz=np.array(FRAME_RATE_HZ), **clouds)
    points, triangles = _drawn(mesh, next(simulate.true_positions(source)), SHOWN_POINTS, rng)
    colors = to_srgb(mesh.colors[mesh.triangles[triangles, 0]]) / 255.0
    return PointCloud(points=points, colors=colors, time=0.0), path


def _drawn(
    mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"], count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "points 3"], np.ndarray]:
    """Points spread evenly over the surfaces with a little noise (m), and the triangle each is on."""
    corners = vertices[mesh.triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(areas), count, p=areas / areas.sum())
    weights = rng.dirichlet(np.ones(3), count)
    points = np.einsum("pc,pcx->px", weights, corners[chosen])
    return points + rng.normal(0.0, NOISE_M, points.shape), chosen


def _silently(_: Progress) -> None:
    """Nobody watches a demonstration being made."""
