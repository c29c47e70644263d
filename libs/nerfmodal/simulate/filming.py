"""A frame of a film: every camera's picture, put together from the instants at which its rows look.

A renderer offers a studio: the structure stands in it as it is at some moment, and cameras look at it.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.simulate.light import to_linear, to_srgb
from nerfmodal.simulate.motion import frame_times, vertices_at
from nerfmodal.simulate.plants import Plant
from nerfmodal.simulate.sensor import Exposure, exposures, is_perfect, sensed, told_rig
from nerfmodal.simulate.stage import check_rig
from nerfmodal.simulate.structures import plant_of
from nerfmodal.spec import SimulationSource
from nerfmodal.types import Camera, Frame, Mesh


@runtime_checkable
class Studio(Protocol):
    """Where a structure stands and is looked at."""

    def move(self, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        """Put the structure's vertices there (world, metres)."""

    def shoot(self, camera: Camera, samples: int) -> UInt8[np.ndarray, "height width 3"]:
        """What the camera sees, by so many rays a pixel."""


OpenStudio = Callable[[Mesh, Float[np.ndarray, "vertices 3"], int], AbstractContextManager[Studio]]
"""A studio of a mesh whose vertices are where the frame's light falls on them, and a seed."""


@dataclass(slots=True)
class _Set:
    """A studio that knows which moment stands in it, so that nothing is moved twice."""

    studio: Studio
    plant: Plant
    source: SimulationSource
    stands: float

    def at(self, time: float) -> Studio:
        """The studio as it is at `time` (s)."""
        if time != self.stands:
            self.studio.move(vertices_at(self.plant, self.source, time))
            self.stands = time
        return self.studio


def film(
    source: SimulationSource, index: int, seed: int, open_studio: OpenStudio, *, report: Callable[[int, int], None]
) -> Frame:
    """All views of frame `index`, with the rig as its calibration tells it.

    `report(done, total)` is called after each view; what it raises stops the filming.
    Raises `InvalidSpec` for modes or cameras that cannot be.
    """
    plant, rig = plant_of(source), semi_spherical_rig(source.rig)
    check_rig(rig, plant)
    time = float(frame_times(source)[index])
    pictures = []
    with open_studio(plant.mesh, vertices_at(plant, source, time), seed) as studio:
        stage = _Set(studio, plant, source, time)
        for view, camera in enumerate(rig.cameras):
            pictures.append(_picture(stage, camera, view, index, time))
            report(view + 1, len(rig.cameras))
    return Frame(index=index, time=time, images=np.stack(pictures), rig=told_rig(rig, source.sensor))


def _picture(stage: _Set, camera: Camera, view: int, frame: int, time: float) -> UInt8[np.ndarray, "height width 3"]:
    sensor, samples = stage.source.sensor, stage.source.samples
    parts = exposures(sensor, view, frame, camera.height)
    if len(parts) == 1 and is_perfect(sensor):
        return stage.at(time + parts[0].offset).shoot(camera, samples)
    light = np.zeros((camera.height, camera.width, 3))
    for part in parts:
        rows = stage.at(time + part.offset).shoot(_rows_of(camera, part), max(1, round(samples * part.share)))
        light[part.first : part.end] += part.share * to_linear(rows)
    return to_srgb(light if is_perfect(sensor) else sensed(light, sensor, view, frame))


def _rows_of(camera: Camera, part: Exposure) -> Camera:
    """The camera that sees these rows alone, at this place in their pixels."""
    across, down = part.shift
    return replace(
        camera,
        height=part.end - part.first,
        center_x=camera.center_x - across,
        center_y=camera.center_y - down - part.first,
    )
