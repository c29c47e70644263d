"""Surfaces of organs and the virtual sensors on them: clouds in, displacement out."""

from nerfmodal.surface.sensors import Reference, Surface, Track
from nerfmodal.surface.track import measure_organ

__all__ = ["Reference", "Surface", "Track", "measure_organ"]
