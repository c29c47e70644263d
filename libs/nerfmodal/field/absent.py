"""A further frame that some cameras lost: it is compared with frame 0 by the cameras that took both pictures.

A pixel that does not count in either picture is shown as in frame 0: it says nothing new.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from nerfmodal.types import Checkpoint, Frame, Rig


def of_common_cameras(parent: Checkpoint, first: Frame, frame: Frame) -> tuple[Checkpoint, Frame, Frame]:
    """Frame 0's checkpoint and both frames, of the cameras that both frames have."""
    names = [camera.name for camera in frame.rig.cameras]
    places = {camera.name: k for k, camera in enumerate(first.rig.cameras)}
    kept = np.array([places[name] for name in names if name in places], dtype=np.int64)
    mine = np.array([k for k, name in enumerate(names) if name in places], dtype=np.int64)
    start, now = _chosen(first, kept), _chosen(frame, mine)
    if start.counts is not None or now.counts is not None:
        counts = np.logical_and(_counts(start), _counts(now))
        now = replace(now, images=np.where(counts[..., None], now.images, start.images), counts=counts)
    if len(kept) == len(first.rig.cameras) or "backgrounds" not in parent.state:
        return parent, start, now
    state = {**parent.state, "backgrounds": parent.state["backgrounds"][kept]}
    return replace(parent, state=state), start, now


def _chosen(frame: Frame, places: Int[np.ndarray, " chosen"]) -> Frame:
    if len(places) == len(frame.images) and (places == np.arange(len(places))).all():
        return frame
    counts = None if frame.counts is None else frame.counts[places]
    rig = Rig(cameras=tuple(frame.rig.cameras[k] for k in places))
    return replace(frame, images=frame.images[places], rig=rig, counts=counts)


def _counts(frame: Frame) -> np.ndarray:
    return np.ones(frame.images.shape[:3], dtype=bool) if frame.counts is None else frame.counts
