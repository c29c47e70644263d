"""Where a field is trained: on a GPU where there is one, else on the processor."""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch

DRIVER = Path("/dev/nvidiactl")
"""Importing torch takes seconds that a grid field on a machine without a GPU's driver need not spend."""


@cache
def gpu() -> "torch.device | None":
    """The GPU, or None where there is none."""
    if not DRIVER.exists():
        return None
    import torch

    return torch.device("cuda") if torch.cuda.is_available() else None


def described() -> tuple[str, str]:
    """The device's name and the precision of products on it, for the provenance."""
    device = gpu()
    if device is None:
        return "cpu", "float32"
    import torch

    return f"cuda ({torch.cuda.get_device_name(device)})", "mixed float16"
