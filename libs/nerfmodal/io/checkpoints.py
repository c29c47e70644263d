"""Checkpoints as safetensors: named arrays and a few strings, so that reading one runs no code."""

from pathlib import Path
from typing import cast, get_args

from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from nerfmodal.errors import InvalidInput
from nerfmodal.io.atomic import atomic_write
from nerfmodal.types import Checkpoint, FieldKind


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint."""
    metadata = {
        "field": checkpoint.field,
        "frame_index": str(checkpoint.frame_index),
        "step": str(checkpoint.step),
        "parent": "" if checkpoint.parent is None else str(checkpoint.parent),
        "psnr": repr(checkpoint.psnr),
        "held_out_psnr": "" if checkpoint.held_out_psnr is None else repr(checkpoint.held_out_psnr),
        "device": checkpoint.device,
    }
    with atomic_write(path) as temporary:
        save_file(checkpoint.state, temporary, metadata=metadata)


def read_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint. Raises `InvalidInput` when the file is none."""
    try:
        with safe_open(path, framework="numpy") as archive:
            metadata = archive.metadata()
            state = {name: archive.get_tensor(name) for name in archive.keys()}  # noqa: SIM118 (no mapping)
        field = metadata["field"]
        if field not in get_args(FieldKind):
            raise KeyError(field)
    except (OSError, KeyError, TypeError, SafetensorError) as error:
        raise InvalidInput(f"is no checkpoint ({error}).", where=str(path), hint="Train the frame again.") from error
    return Checkpoint(
        field=cast(FieldKind, field),
        frame_index=int(metadata["frame_index"]),
        step=int(metadata["step"]),
        parent=int(metadata["parent"]) if metadata["parent"] else None,
        state=state,
        psnr=float(metadata["psnr"]),
        held_out_psnr=float(metadata["held_out_psnr"]) if metadata["held_out_psnr"] else None,
        device=metadata.get("device", ""),
    )
