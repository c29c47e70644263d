"""A mode as a PLY: the sensors at rest with the displacement of a unit modal coordinate as vectors.

Binary little-endian, properties x y z dx dy dz (float32, metres per metre of modal coordinate); ParaView and
CloudCompare read the last three as a vector field.
"""

from pathlib import Path

import numpy as np

from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult

PROPERTIES = ("x", "y", "z", "dx", "dy", "dz")


def write_vectors(organ: OrganResult, k: int, path: Path) -> Path:
    """Write mode `k` (counted from 0) of the organ as a .ply with displacement vectors."""
    positions = organ.displacement.sensors.positions
    motion = organ.model.mode_shapes[:, :, k] @ organ.displacement.directions
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {organ.organ} mode {k}: {float(organ.model.frequencies[k]):.6g} Hz, largest component 1",
        f"element vertex {len(positions)}",
        *(f"property float {name}" for name in PROPERTIES),
        "end_header\n",
    ]
    rows = np.concatenate([positions, motion], axis=1).astype("<f4")
    with atomic_write(path) as temporary:
        temporary.write_bytes("\n".join(header).encode("ascii") + rows.tobytes())
    return path
