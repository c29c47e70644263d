"""Point clouds out of trained fields, and the organs in them."""

from nerfmodal.cloud.assignment import assign, specify
from nerfmodal.cloud.extract import extract
from nerfmodal.cloud.organs import FoundOrgan, find_organs

__all__ = ["FoundOrgan", "assign", "extract", "find_organs", "specify"]
