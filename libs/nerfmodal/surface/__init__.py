"""Surfaces of organs and the virtual sensors on them: clouds in, displacement out."""

from nerfmodal.surface.following import Follower, follow
from nerfmodal.surface.material import is_material
from nerfmodal.surface.sensors import Reference, Surface, Track
from nerfmodal.surface.track import FEWEST_INLIERS, measure_organ

__all__ = ["FEWEST_INLIERS", "Follower", "Reference", "Surface", "Track", "follow", "is_material", "measure_organ"]
