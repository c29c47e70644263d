"""Motion of material points: what the pictures of a frame say of how each organ of frame 0 has moved.

Frame 0's field gives the places; its pictures give the texture; a smooth displacement of every organ is sought that
makes them the pictures of the frame. Points are then the same places of the structure in every cloud, with three axes.
"""

from nerfmodal.tracking.checkpoints import cloud_of, followed
from nerfmodal.tracking.following import Followed, Loss, follow
from nerfmodal.tracking.reference import (
    Labels,
    Reference,
    has_reference,
    prepare,
    reference_arrays,
    reference_of,
)

__all__ = [
    "Followed",
    "Labels",
    "Loss",
    "Reference",
    "cloud_of",
    "follow",
    "followed",
    "has_reference",
    "prepare",
    "reference_arrays",
    "reference_of",
]
