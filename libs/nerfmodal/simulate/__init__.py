"""Simulated plants: their shape, their motion (the truth) and their pictures. Imports nothing heavy."""

from collections.abc import Callable

from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.simulate.motion import check_organs, frame_times, true_modes, vertices_at
from nerfmodal.simulate.palm import acai
from nerfmodal.simulate.plants import Plant
from nerfmodal.simulate.stage import check_rig
from nerfmodal.simulate.structures import plant_of
from nerfmodal.spec import Box, OrganSpec, SimulationSource
from nerfmodal.types import Frame

__all__ = [
    "Plant",
    "acai",
    "check_source",
    "default_organs",
    "default_region",
    "frame_times",
    "plant_of",
    "render_frame",
    "true_modes",
    "vertices_at",
]


def render_frame(source: SimulationSource, index: int, seed: int, *, report: Callable[[int, int], None]) -> Frame:
    """All views of frame `index` by the source's renderer; `report(done, total)` after each view may raise.

    Raises `MissingExtra` without the renderer's wheel and `InvalidSpec` for modes or cameras that cannot be.
    """
    if source.renderer == "blender":
        from nerfmodal.simulate import blender

        return blender.render_frame(source, index, seed, report=report)
    from nerfmodal.simulate import preview

    return preview.render_frame(source, index, seed, report=report)


def check_source(source: SimulationSource) -> None:
    """Refuse modes of organs that do not exist and cameras that cannot be: `InvalidSpec` with the key."""
    plant = plant_of(source)
    check_organs(source, plant)
    check_rig(semi_spherical_rig(source.rig), plant)


def default_region(source: SimulationSource) -> Box:
    """The box that holds the plant and its motion, from just above the ground."""
    return plant_of(source).region


def default_organs(source: SimulationSource) -> tuple[OrganSpec, ...]:
    """The plant's organs: leaves as polynomials of degree 5, stems as cylinders of degree 4."""
    return tuple(
        OrganSpec(name=organ.name, region=organ.region, surface="polynomial", degree=5)
        if organ.kind == "leaf"
        else OrganSpec(name=organ.name, region=organ.region, surface="cylinder", degree=4)
        for organ in plant_of(source).organs
    )
