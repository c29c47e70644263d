"""The paper's experiment beside its truth: the table of frequencies, damping, shapes and displacement, and its figures.

Source: Ribeiro, Cardoso, Costa and Silva, "Full-Field 3D Structural Dynamics via Neural Radiance Fields".
"""

from nerfmodal.reproduction.document import experiment_document, goals_of
from nerfmodal.reproduction.page import page
from nerfmodal.reproduction.pictures import paper_figures
from nerfmodal.reproduction.scores import score

__all__ = ["experiment_document", "goals_of", "page", "paper_figures", "score"]
