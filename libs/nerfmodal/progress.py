"""How far a stage is, as it tells whoever waits for it. Imports nothing heavy: who only waits needs no torch."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far a stage is: `done` of `total` units, and what it would say of itself (loss, PSNR, rays/s)."""

    done: int
    total: int
    message: str = ""


Report = Callable[[Progress], None]
"""Called often by long stages; whatever it raises stops the stage (this is how a scan is cancelled)."""
