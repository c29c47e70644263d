"""How full the disk is that a worker or the API writes to."""

import errno
import os
import shutil
from pathlib import Path
from typing import Final

from scanjobs.settings import Settings

ENOUGH: Final = 1.25


def is_low(settings: Settings) -> bool:
    """Whether less than `disk_low_mb` is left for the data folder or the artifacts: nothing new is begun then."""
    return free_bytes(settings) < settings.disk_low_mb * 10**6


def has_room(settings: Settings) -> bool:
    """Whether so much is left that what was paused for a low disk goes on: a little more than what paused it."""
    return free_bytes(settings) > ENOUGH * settings.disk_low_mb * 10**6


def free_bytes(settings: Settings) -> int:
    """What is left where the data folder and the artifacts lie, the lesser of both."""
    return min(shutil.disk_usage(_existing(folder)).free for folder in (settings.data_folder, settings.artifacts))


def is_full(error: OSError) -> bool:
    """Whether an operation failed for want of room."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def _existing(folder: Path) -> Path:
    """The folder, or the nearest one above it that is there."""
    path = folder.resolve()
    while not os.path.exists(path):
        path = path.parent
    return path
