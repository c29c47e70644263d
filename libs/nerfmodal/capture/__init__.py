"""Real captures: which pictures and cameras belong to which instant."""

from nerfmodal.capture.folder import Capture, check_pictures, open_capture, read_frame, split_held_out

__all__ = ["Capture", "check_pictures", "open_capture", "read_frame", "split_held_out"]
