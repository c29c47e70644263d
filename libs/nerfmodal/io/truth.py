"""The truth of a simulation: imposed modes as one .npz that only comparison code reads."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nerfmodal.errors import InvalidInput
from nerfmodal.io.atomic import atomic_write
from nerfmodal.types import TrueMode


def write_truth(path: Path, modes: Sequence[TrueMode]) -> None:
    """Write imposed modes."""
    arrays: dict[str, np.ndarray] = {"names": np.array([[mode.organ, mode.name] for mode in modes], dtype=str)}
    arrays["values"] = np.array([[mode.frequency, mode.damping_ratio] for mode in modes])
    for index, mode in enumerate(modes):
        arrays[f"points_{index}"] = mode.points
        arrays[f"shape_{index}"] = mode.shape
        arrays[f"coordinates_{index}"] = mode.coordinates
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_truth(path: Path) -> tuple[TrueMode, ...]:
    """Read imposed modes. Raises `InvalidInput` when the file is no truth."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return tuple(
                TrueMode(
                    organ=str(organ),
                    name=str(name),
                    frequency=float(archive["values"][index, 0]),
                    damping_ratio=float(archive["values"][index, 1]),
                    points=archive[f"points_{index}"],
                    shape=archive[f"shape_{index}"],
                    coordinates=archive[f"coordinates_{index}"],
                )
                for index, (organ, name) in enumerate(archive["names"])
            )
    except (OSError, KeyError, ValueError) as error:
        raise InvalidInput(f"is no truth file ({error}).", where=str(path), hint="Simulate the scan again.") from error
