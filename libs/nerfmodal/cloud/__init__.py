"""Point clouds out of trained fields."""

from nerfmodal.cloud.extract import extract

__all__ = ["extract"]
