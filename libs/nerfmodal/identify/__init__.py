"""Modes of an organ from its displacement."""

from nerfmodal.identify.model import Factors, identify, identify_scan

__all__ = ["Factors", "identify", "identify_scan"]
