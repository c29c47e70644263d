"""Radiance fields: the paper's network and the fast grid, behind one interface."""

from nerfmodal.field.absent import of_common_cameras
from nerfmodal.field.ground import find_ground
from nerfmodal.field.training import Scene, fine_tune, fit, looker, voxel_of

__all__ = ["Scene", "find_ground", "fine_tune", "fit", "looker", "of_common_cameras", "voxel_of"]
