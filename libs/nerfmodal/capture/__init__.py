"""Real captures: which pictures and cameras belong to which instant."""

from nerfmodal.capture.opening import open_capture
from nerfmodal.capture.record import Capture, Clock, split_held_out

__all__ = ["Capture", "Clock", "open_capture", "split_held_out"]
