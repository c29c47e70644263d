"""A followed frame as a checkpoint, and as a cloud: what the steps of a scan hand on."""

import numpy as np

from nerfmodal.tracking.following import Loss, follow
from nerfmodal.tracking.reference import reference_of
from nerfmodal.types import Checkpoint, Frame, Outcome, PointCloud


def followed(parent: Checkpoint, first: Frame, frame: Frame) -> tuple[Checkpoint, dict[str, Loss]]:
    """The points of frame 0 where `frame` shows them, and which organs were lost why.

    `parent` is frame 0's checkpoint with its reference and backgrounds.
    """
    reference = reference_of(parent.state)
    moved = follow(reference, parent.state["backgrounds"], first, frame)
    checkpoint = Checkpoint(
        field="moved",
        frame_index=frame.index,
        step=0,
        parent=parent.frame_index,
        state={"points": moved.points, "colors": reference.colors, "stds": moved.stds},
        psnr=parent.psnr,
        held_out_psnr=parent.held_out_psnr,
        device=parent.device,
    )
    return checkpoint, moved.losses


def cloud_of(checkpoint: Checkpoint, time: float) -> PointCloud:
    """The cloud of a followed frame; its points are material. `NOT_FOLLOWED` when every organ was lost."""
    stds = checkpoint.state["stds"]
    return PointCloud(
        points=checkpoint.state["points"],
        colors=checkpoint.state["colors"],
        time=time,
        outcome=Outcome.OK if np.isfinite(stds).any() else Outcome.NOT_FOLLOWED,
        device=checkpoint.device,
        stds=stds,
    )
