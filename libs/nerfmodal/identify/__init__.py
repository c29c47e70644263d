"""Modes of an organ from its displacement."""

from nerfmodal.identify.model import identify, identify_scan

__all__ = ["identify", "identify_scan"]
