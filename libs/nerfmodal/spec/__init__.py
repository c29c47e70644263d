"""What a user asks for: one frozen tree that is the HTTP body, the JSON column and the configuration.

SI units; a unit suffix stands on every key because types are lost in JSON. Unknown keys are refused.
"""

from nerfmodal.spec.capture import CameraDistance, CaptureSource, Checkerboard, CloudsSource, PointDistance, Scale
from nerfmodal.spec.parts import Box, Metres, Name, OrientedBox, Part, Point, PositiveMetres
from nerfmodal.spec.scan import IdentificationSpec, OrganSpec, PlantSpec, ReconstructionSpec, ScanSpec, Source
from nerfmodal.spec.simulation import (
    HIGHEST_SHARE_OF_FRAME_RATE,
    AirPulse,
    Excitation,
    FreeDecay,
    Harmonic,
    ImposedMode,
    PalmSpec,
    RigSpec,
    SensorSpec,
    SimulationSource,
    Wind,
    modes_of,
)

__all__ = [
    "HIGHEST_SHARE_OF_FRAME_RATE",
    "AirPulse",
    "Box",
    "CameraDistance",
    "CaptureSource",
    "Checkerboard",
    "CloudsSource",
    "Excitation",
    "FreeDecay",
    "Harmonic",
    "IdentificationSpec",
    "ImposedMode",
    "Metres",
    "Name",
    "OrganSpec",
    "OrientedBox",
    "PalmSpec",
    "Part",
    "PlantSpec",
    "Point",
    "PointDistance",
    "PositiveMetres",
    "ReconstructionSpec",
    "RigSpec",
    "Scale",
    "ScanSpec",
    "SensorSpec",
    "SimulationSource",
    "Source",
    "Wind",
    "modes_of",
]
