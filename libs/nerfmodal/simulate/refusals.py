"""Scenes that cannot be, refused before anything is rendered: each by its key, with the remedy."""

import numpy as np

from nerfmodal.errors import InvalidSpec
from nerfmodal.simulate.excitation import largest_swing
from nerfmodal.simulate.kinematics import direction_of, shifted, turned
from nerfmodal.simulate.plants import Organ, Plant
from nerfmodal.spec import ImposedMode, PalmSpec, SimulationSource, Wind, modes_of

STEEPEST = {"linear": 1.0, "rotation": np.pi / 2}
"""Slope of an offset, and radians of a turn, beyond which a member is stretched by half or folds back on itself."""
ALONG_ITSELF = 0.999
"""Cosine of the angle between a member and a direction that is taken for its own."""


def check_organs(source: SimulationSource, plant: Plant) -> None:
    """Refuse a mode whose organ matches nothing. Raises `InvalidSpec`."""
    names = [organ.name for organ in plant.organs]
    for index, mode in enumerate(source.motion):
        if not any(modes_of((mode,), name) for name in names):
            raise InvalidSpec(
                f"'{mode.organ}' matches no organ of '{source.structure}'.",
                where=f"/source/motion/{index}/organ",
                hint=f"Its organs are {', '.join(names)}; a glob such as 'leaf_*' names several.",
            )


def check_motion(source: SimulationSource, plant: Plant) -> None:
    """Refuse shapes that an organ cannot have and swings that would fold it. Raises `InvalidSpec`."""
    if source.structure != "acai" and source.palm != PalmSpec():
        raise InvalidSpec(
            f"are the sizes of a palm, not of '{source.structure}'.",
            where="/source/palm",
            hint="Use structure acai, or leave palm out.",
        )
    check_organs(source, plant)
    for organ in plant.organs:
        for mode in modes_of(source.motion, organ.name):
            _check_shape(source, organ, mode)
        _check_swing(source, plant, organ)


def check_sensor(source: SimulationSource) -> None:
    """Refuse a picture that takes longer than the time between two, and a wind above what a frame sees."""
    period = 1 / source.frame_rate_hz
    if source.sensor.shutter_s > period:
        raise InvalidSpec(
            f"a shutter of {source.sensor.shutter_s:g} s is still open when the next frame begins.",
            where="/source/sensor/shutter_s",
            hint=f"At this frame rate it is {period:.4g} s at the most.",
        )
    if source.sensor.rolling_shutter_s > period:
        raise InvalidSpec(
            f"rows that take {source.sensor.rolling_shutter_s:g} s are not read when the next frame begins.",
            where="/source/sensor/rolling_shutter_s",
            hint=f"At this frame rate it is {period:.4g} s at the most.",
        )
    force = source.excitation
    if isinstance(force, Wind) and force.high_hz is None and force.low_hz >= source.frame_rate_hz / 2:
        raise InvalidSpec(
            "no wind is left between low_hz and half the frame rate.",
            where="/source/excitation/low_hz",
            hint=f"Give one below {source.frame_rate_hz / 2:g}, or a high_hz above it.",
        )


def _check_shape(source: SimulationSource, organ: Organ, mode: ImposedMode) -> None:
    place = f"/source/motion/{source.motion.index(mode)}"
    if mode.shape.startswith("plate") != (organ.kind == "plate"):
        own = "plate_1 to plate_4" if organ.kind == "plate" else "bending_1 to bending_3"
        raise InvalidSpec(
            f"'{mode.shape}' is no shape of {organ.name}.", where=f"{place}/shape", hint=f"Its shapes are {own}."
        )
    if mode.shape.startswith("torsion") and organ.kind != "leaf":
        raise InvalidSpec(
            f"{organ.name} is round: turned about itself it looks the same.",
            where=f"{place}/shape",
            hint="Use bending_1 to bending_3, or twist a leaf.",
        )
    if organ.kind == "plate" and source.kinematics == "rotation":
        raise InvalidSpec(
            "a plate is no slender member.", where="/source/kinematics", hint="Use kinematics linear for a plate."
        )
    _check_direction(source, organ, mode, place)


def _check_direction(source: SimulationSource, organ: Organ, mode: ImposedMode, place: str) -> None:
    if mode.direction is not None and not np.any(mode.direction):
        raise InvalidSpec(
            "is no direction: its length is 0.", where=f"{place}/direction", hint="Give a vector such as [0, 0, 1]."
        )
    bends = source.kinematics == "rotation" and mode.shape.startswith("bending")
    if bends and abs(direction_of(organ, mode) @ organ.chord) > ALONG_ITSELF:
        raise InvalidSpec(
            f"runs along {organ.name}: nothing bends that way.",
            where=f"{place}/direction",
            hint="Give a direction across the member.",
        )


def _check_swing(source: SimulationSource, plant: Plant, organ: Organ) -> None:
    """The steepest slopes of all modes of the organ add up, bending apart from torsion."""
    modes = modes_of(source.motion, organ.name)
    limit, linear = STEEPEST[source.kinematics], source.kinematics == "linear"
    for family in ("bending", "torsion"):
        slopes = [(_steepest(source, plant, organ, mode), mode) for mode in modes if mode.shape.startswith(family)]
        whole = sum(slope for slope, _ in slopes)
        if whole > limit:
            worst = max(slopes, key=lambda pair: pair[0])[1]
            raise InvalidSpec(
                f"{organ.name} would turn by {np.degrees(np.arctan(whole) if linear else whole):.0f} degrees and fold.",
                where=f"/source/motion/{source.motion.index(worst)}/amplitude_m",
                hint=f"{45 if linear else 90} degrees are possible with kinematics '{source.kinematics}': "
                f"give amplitudes {int(100 * limit / whole) / 100:.2f} times as large, or less.",
            )


def _steepest(source: SimulationSource, plant: Plant, organ: Organ, mode: ImposedMode) -> float:
    sway = (turned if source.kinematics == "rotation" else shifted)(plant, organ, mode)
    return float(np.linalg.norm(sway.turns, axis=1).max()) * largest_swing(mode, source.excitation)
