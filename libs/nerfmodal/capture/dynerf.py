"""DyNeRF (Neural 3D Video): cam00.mp4 … and poses_bounds.npy, as LLFF writes it.

A row is a 3 x 5 matrix [R | t | (height, width, focal)] and two depths. LLFF's camera axes are down, right, backwards;
rows belong to the videos in the order of their names. Its scenes are synchronised, and have no metres of their own.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from nerfmodal.capture.footage import find_footage
from nerfmodal.capture.layout import Layout
from nerfmodal.errors import InvalidCapture
from nerfmodal.io.transforms import rigid_pose
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Camera

FILE = "poses_bounds.npy"


def dynerf_layout(source: CaptureSource) -> Layout:
    """A folder of DyNeRF. Raises `InvalidCapture`, naming the file and the remedy."""
    where = Path(source.path) / FILE
    rows = _read_rows(where)
    filmed = find_footage(Path(source.path))
    if len(filmed) != len(rows):
        raise InvalidCapture(
            f"has {len(rows)} poses for {len(filmed)} cameras ({', '.join(sorted(filmed)[:4])} …).",
            where=str(where),
            hint="There must be one row for every video, in the order of their names.",
        )
    cameras = tuple(
        _camera(name, row, f"{where}, row {number}")
        for number, (name, row) in enumerate(zip(sorted(filmed), rows, strict=True))
    )
    return Layout(where=str(where), cameras=cameras, filmed=filmed, trusted=True)


def _read_rows(where: Path) -> Float[np.ndarray, "cameras 17"]:
    try:
        rows = np.asarray(np.load(where, allow_pickle=False), dtype=float)
    except (OSError, ValueError, EOFError) as error:
        raise InvalidCapture(f"cannot be read ({error}).", where=str(where), hint="Copy it again.") from error
    if rows.ndim != 2 or rows.shape[1] != 17:
        raise InvalidCapture(
            f"has the shape {rows.shape}.", where=str(where), hint="LLFF writes 17 numbers for a camera."
        )
    return rows


def _camera(name: str, row: Float[np.ndarray, " 17"], where: str) -> Camera:
    matrix = row[:15].reshape(3, 5)
    down, right, back, position = matrix[:, :4].T
    pose = rigid_pose(np.stack([right, -down, back, position], axis=1), where)
    height, width, focal = matrix[:, 4]
    if not (np.isfinite(matrix[:, 4]).all() and min(height, width, focal) > 0):
        raise InvalidCapture(
            f"has height, width and focal length {matrix[:, 4]}.", where=where, hint="All must be positive, in pixels."
        )
    return Camera(
        name=name,
        width=int(width),
        height=int(height),
        focal_x=float(focal),
        focal_y=float(focal),
        center_x=width / 2,
        center_y=height / 2,
        camera_to_world=pose,
    )
