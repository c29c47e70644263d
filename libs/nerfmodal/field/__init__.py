"""Radiance fields: the paper's network and the fast grid, behind one interface."""

from nerfmodal.field.training import Scene, fine_tune, fit, looker

__all__ = ["Scene", "fine_tune", "fit", "looker"]
