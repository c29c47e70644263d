"""What a scan can and cannot find, told from its specification before anything runs. Imports nothing heavy."""

from nerfmodal.preflight.answer import Cost, Finding, ModeForecast, Optics, Preflight, RecordLimits, StepCost
from nerfmodal.preflight.before import preflight
from nerfmodal.preflight.expected import ExpectedMode, Seen
from nerfmodal.preflight.work import Pace, PastStep, pace_of, units_of, variant_of

__all__ = [
    "Cost",
    "ExpectedMode",
    "Finding",
    "ModeForecast",
    "Optics",
    "Pace",
    "PastStep",
    "Preflight",
    "RecordLimits",
    "Seen",
    "StepCost",
    "pace_of",
    "preflight",
    "units_of",
    "variant_of",
]
