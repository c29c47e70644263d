"""Real captures: which pictures and cameras belong to which instant."""

from nerfmodal.capture.folder import Capture, open_capture, read_frame, split_held_out

__all__ = ["Capture", "open_capture", "read_frame", "split_held_out"]
