"""The pictures of a scan: the paper's Figures 4 to 9 and the report's, each a function from values to a figure."""

from nerfmodal.figures.album import draw
from nerfmodal.figures.cameras import camera_views, plant_views
from nerfmodal.figures.clouds import cloud
from nerfmodal.figures.eigenvalues import eigenvalues
from nerfmodal.figures.films import film, write_film
from nerfmodal.figures.shapes import magnified_frames, mode_shapes
from nerfmodal.figures.signals import modal_coordinates, principal_components
from nerfmodal.figures.stabilisation import stabilisation
from nerfmodal.figures.structure import structure_shapes
from nerfmodal.figures.style import save

__all__ = [
    "camera_views",
    "cloud",
    "draw",
    "eigenvalues",
    "film",
    "magnified_frames",
    "modal_coordinates",
    "mode_shapes",
    "plant_views",
    "principal_components",
    "save",
    "stabilisation",
    "structure_shapes",
    "write_film",
]
