"""Simulated plants: their shape, their motion (the truth) and their pictures. Imports nothing heavy."""

from collections.abc import Callable

from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.simulate.filming import film
from nerfmodal.simulate.motion import frame_times, modal_masses, reach, shape_at, true_modes, vertices_at
from nerfmodal.simulate.palm import acai
from nerfmodal.simulate.plants import EDGE_ROOM, MOTION_ROOM, Organ, Plant
from nerfmodal.simulate.refusals import check_motion, check_sensor
from nerfmodal.simulate.stage import check_rig
from nerfmodal.simulate.structures import plant_of
from nerfmodal.simulate.truth import true_depths, true_positions, true_scene
from nerfmodal.spec import Box, OrganSpec, OrientedBox, SimulationSource
from nerfmodal.types import Frame

__all__ = [
    "Plant",
    "acai",
    "check_source",
    "default_organs",
    "default_region",
    "frame_times",
    "modal_masses",
    "plant_of",
    "render_frame",
    "shape_at",
    "true_depths",
    "true_modes",
    "true_positions",
    "true_scene",
    "vertices_at",
]


def render_frame(source: SimulationSource, index: int, seed: int, *, report: Callable[[int, int], None]) -> Frame:
    """All views of frame `index` by the source's renderer; `report(done, total)` after each view may raise.

    Raises `MissingExtra` without the renderer's wheel and `InvalidSpec` for modes or cameras that cannot be.
    """
    if source.renderer == "blender":
        from nerfmodal.simulate import blender

        return film(source, index, seed, blender.open_studio, report=report)
    from nerfmodal.simulate import preview

    return film(source, index, seed, preview.open_studio, report=report)


def check_source(source: SimulationSource) -> None:
    """Refuse what cannot be filmed: `InvalidSpec` with the key and the remedy."""
    plant = plant_of(source)
    check_motion(source, plant)
    check_sensor(source)
    check_rig(semi_spherical_rig(source.rig), plant)


def default_region(source: SimulationSource) -> Box:
    """The box that holds the plant and its motion, from just above the ground."""
    plant = plant_of(source)
    further = max((_further_room(source, organ.name) for organ in plant.organs), default=0.0)
    (x, y, low), (right, back, high) = plant.region.min_m, plant.region.max_m
    return Box(min_m=(x - further, y - further, low), max_m=(right + further, back + further, high + further))


def default_organs(source: SimulationSource) -> tuple[OrganSpec, ...]:
    """The structure's organs: sheets as polynomials of degree 5, stems and branches as cylinders of degree 4."""
    return tuple(
        OrganSpec(name=organ.name, region=_region(source, organ), surface="polynomial", degree=5)
        if organ.kind in {"leaf", "plate"}
        else OrganSpec(name=organ.name, region=_region(source, organ), surface="cylinder", degree=4)
        for organ in plant_of(source).organs
    )


def _region(source: SimulationSource, organ: Organ) -> OrientedBox:
    """The organ's box, with room for a motion that goes further than usual."""
    further = _further_room(source, organ.name)
    along, across, up = organ.region.size_m
    size = (
        (along, across, up + 2 * further)
        if organ.kind in {"leaf", "plate"}
        else (along, across + 2 * further, up + 2 * further)
    )
    return organ.region if further == 0 else organ.region.model_copy(update={"size_m": size})


def _further_room(source: SimulationSource, organ: str) -> float:
    return max(0.0, reach(source, organ) - MOTION_ROOM - EDGE_ROOM)
