"""What a simulation knows beside its modes: the mesh, the true cameras, where every vertex went, and depth maps."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.simulate.motion import frame_times, modal_masses, vertices_at
from nerfmodal.simulate.structures import plant_of
from nerfmodal.spec import SimulationSource
from nerfmodal.types import Rig, TrueScene


def true_scene(source: SimulationSource) -> TrueScene:
    """The mesh at rest, the instants, the cameras as they stand, and the modal masses."""
    return TrueScene(
        mesh=plant_of(source).mesh,
        times=frame_times(source),
        rig=semi_spherical_rig(source.rig),
        modal_masses=modal_masses(source),
    )


def true_positions(source: SimulationSource) -> Iterator[Float[np.ndarray, "vertices 3"]]:
    """Positions of the mesh's vertices in every frame (world, metres)."""
    plant = plant_of(source)
    return (vertices_at(plant, source, float(time)) for time in frame_times(source))


def true_depths(source: SimulationSource, index: int) -> tuple[Rig, Float[np.ndarray, "cameras height width"]]:
    """The true cameras, and what they see in frame `index`: metres along the optical axis, infinite in the sky.

    Raises `MissingExtra` without open3d.
    """
    from nerfmodal.simulate import preview

    plant, rig = plant_of(source), semi_spherical_rig(source.rig)
    vertices = vertices_at(plant, source, float(frame_times(source)[index]))
    return rig, preview.depth_maps(plant.mesh, vertices, rig.cameras)
