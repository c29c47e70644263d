"""Modes of an organ from its displacement."""

from nerfmodal.identify.growing import FrameFit, GrowingRecord, modes_so_far
from nerfmodal.identify.modal_motion import modal_motion
from nerfmodal.identify.model import identify, identify_scan

__all__ = ["FrameFit", "GrowingRecord", "identify", "identify_scan", "modal_motion", "modes_so_far"]
