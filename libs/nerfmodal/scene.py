"""Where the scene of a scan lies: the box that is reconstructed finely, and the ground that the structure stands on."""

from dataclasses import replace

import numpy as np

from nerfmodal import field, simulate
from nerfmodal.geometry.cameras import focus_of
from nerfmodal.progress import Progress, Report
from nerfmodal.spec import Box, ScanSpec, SimulationSource
from nerfmodal.types import Frame

REGION_SHARE = 0.9
"""Half the side of a capture's default region, in mean distances from the cameras to what they look at."""


def scene_of(spec: ScanSpec, frame: Frame) -> field.Scene:
    """The box: the one given, else a simulation's own, what moves, or what all cameras look at. No ground is known."""
    box = spec.reconstruction.region or _own_region(spec)
    if box is not None:
        low, high = np.array(box.min_m, dtype=float), np.array(box.max_m, dtype=float)
    elif frame.region is not None:
        low, high = frame.region
    else:
        center, distance = focus_of(frame.rig)
        low, high = center - REGION_SHARE * distance, center + REGION_SHARE * distance
    return field.Scene(low=low, high=high, ground=None)


def grounded(scene: field.Scene, spec: ScanSpec, first: Frame, *, report: Report) -> field.Scene:
    """The scene with its ground: the one given, else a simulation's own, or what the pictures of frame 0 say."""
    height = spec.reconstruction.ground_m
    if height == "none":
        return scene
    if height is None and isinstance(spec.source, SimulationSource):
        height = 0.0
    if height is not None:
        return replace(scene, ground=np.array([height, 0.0, 0.0]))
    report(Progress(done=0, total=1, message="looking for the ground"))
    ground = field.find_ground(first)
    found = "no ground was found" if ground is None else f"the ground was found at z = {ground[0]:.3f} m"
    report(Progress(done=0, total=1, message=found))
    return replace(scene, ground=ground)


def _own_region(spec: ScanSpec) -> Box | None:
    return simulate.default_region(spec.source) if isinstance(spec.source, SimulationSource) else None
