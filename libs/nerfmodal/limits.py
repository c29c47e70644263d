"""Limits that the service's door and the readers of files share."""

from typing import Final

LARGEST_PICTURE: Final = 60_000_000
"""Pixels; a larger one is taken for a decompression bomb."""
