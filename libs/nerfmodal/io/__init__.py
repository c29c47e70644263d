"""Readers and writers of the travelling types; every write is atomic, nothing is pickled."""

from nerfmodal.io.atomic import atomic_write
from nerfmodal.io.checkpoints import read_checkpoint, write_checkpoint
from nerfmodal.io.clouds import read_cloud, write_cloud
from nerfmodal.io.frames import read_frame, write_frame
from nerfmodal.io.results import read_result, write_result
from nerfmodal.io.resume import ResumeFile
from nerfmodal.io.sequences import CloudSequence, open_clouds
from nerfmodal.io.truth import read_depths, read_positions, read_scene, read_truth, write_depths, write_truth

__all__ = [
    "CloudSequence",
    "ResumeFile",
    "atomic_write",
    "open_clouds",
    "read_checkpoint",
    "read_cloud",
    "read_depths",
    "read_frame",
    "read_positions",
    "read_result",
    "read_scene",
    "read_truth",
    "write_checkpoint",
    "write_cloud",
    "write_depths",
    "write_frame",
    "write_result",
    "write_truth",
]
