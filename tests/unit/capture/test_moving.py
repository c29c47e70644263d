"""The part that moves: a disc on a stick that is drawn where its place in the world projects."""

from pathlib import Path

import numpy as np
import pytest
from nerfmodal.capture import open_capture
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import project, semi_spherical_rig
from nerfmodal.spec import CaptureSource, RigSpec
from nerfmodal.types import Frame

from tests.fixtures.formats import RATE, write_transforms

RIG = semi_spherical_rig(
    RigSpec(cameras=8, width_px=96, height_px=96, radius_m=3.0, target_m=(0, 0, 1), lowest_deg=5, highest_deg=60)
)
RADIUS = 0.08
CENTER = np.array([0.35, -0.2, 1.2])


def film(amplitude: float, frames: int = 8) -> list[Frame]:
    """A ball that swings along x before still patterns, with noise of one grey level."""
    rng = np.random.default_rng(0)
    return [
        Frame(index=k, time=k / RATE, rig=RIG, images=views(CENTER + [amplitude * np.sin(1.3 * k), 0, 0], rng))
        for k in range(frames)
    ]


def views(place: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    rows, columns = np.mgrid[0:96, 0:96] + 0.5
    pictures = []
    for camera in RIG.cameras:
        (pixel,), (depth,) = project(camera, place[None])
        inside = np.hypot(columns - pixel[0], rows - pixel[1]) < RADIUS * camera.focal_x / depth
        grey = np.where(inside, 220, 80 + 30 * np.sin(columns / 5)) + rng.normal(0, 1, rows.shape)
        pictures.append(np.repeat(grey[:, :, None], 3, axis=2))
    return np.stack(pictures).clip(0, 255).astype(np.uint8)


def source(folder: Path) -> CaptureSource:
    return CaptureSource(kind="capture", path=str(folder), region="moving")


def test_the_box_holds_what_moves_and_little_else(tmp_path: Path) -> None:
    write_transforms(tmp_path, film(0.15))
    frame = open_capture(source(tmp_path)).read(3)
    assert frame.region is not None
    low, high = frame.region
    swept_low, swept_high = CENTER - RADIUS - [0.15, 0, 0], CENTER + RADIUS + [0.15, 0, 0]
    assert (low <= swept_low).all()
    assert (high >= swept_high).all()
    assert ((high - low) <= (swept_high - swept_low) + 0.25).all()


@pytest.mark.parametrize(("amplitude", "frames", "said"), [(0.0, 8, "no pixel changes"), (0.15, 1, "one frame")])
def test_where_nothing_moves_a_box_must_be_given(tmp_path: Path, amplitude: float, frames: int, said: str) -> None:
    write_transforms(tmp_path, film(amplitude, frames))
    with pytest.raises(InvalidCapture, match=said) as caught:
        open_capture(source(tmp_path))
    assert "reconstruction.region" in str(caught.value.hint)
