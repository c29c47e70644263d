"""What a scan's files are called outside: results by their own relative path, the others by what they are.

::

    modes.json, report.html, shapes/leaf_0_1.npz …       what scan.identify published
    truth.npz                                            what a simulation imposed
    frames/frame_0003.zip  clouds/frame_0003.ply  checkpoints/first.safetensors  checkpoints/frame_0003.safetensors
"""

from collections.abc import Mapping
from pathlib import PurePosixPath

from scanjobs.messages import EXTRACT, IDENTIFY, READ, RENDER, TRAIN
from scanjobs.plan import WHOLE_SCAN
from scanjobs.repository import StoredFile

FOLDERS: Mapping[str, str] = {RENDER: "frames", READ: "frames", TRAIN: "checkpoints", EXTRACT: "clouds"}
MAIN_ROLES = frozenset({"frame", "checkpoint", "cloud"})


def public_name(file: StoredFile) -> str:
    """The relative path that a user saves the file as; no two files of a scan share one."""
    if file.kind == IDENTIFY:
        return file.role
    if file.role == "truth":
        return PurePosixPath(file.name).name
    stem = "first" if file.frame == WHOLE_SCAN else f"frame_{file.frame:04d}"
    kept_apart = "" if file.role in MAIN_ROLES else f"_{file.role}"
    return f"{FOLDERS.get(file.kind, file.kind)}/{stem}{kept_apart}{PurePosixPath(file.name).suffix}"
