"""A camera that lost a picture does not stop a frame: it is trained and seen by the cameras that took it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from nerfmodal import capture, field
from nerfmodal.capture.record import some_views
from nerfmodal.field.views import views_of
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Checkpoint, Frame

from tests.fixtures.formats import write_transforms
from tests.unit.capture.test_moving import film
from tests.unit.field.test_learning import (
    RADIUS,
    SCENE,
    SETTINGS,
    ball_frame,
    center_of,
    cloud_of,
    off_the_ball,
    silent,
)

AMPLITUDE = 0.15


def without(frame: Frame, name: str) -> Frame:
    """The frame without a camera."""
    return some_views(frame, np.array([camera.name != name for camera in frame.rig.cameras]))


def test_a_frame_that_a_camera_lost_is_reconstructed() -> None:
    """Frame 0 has lost one camera and a later frame another; the later one moves as it does for all cameras."""
    center = np.array([0.08, 0.0, 0.83])
    first = without(ball_frame(0, np.array([0.0, 0.0, 0.75])), "cam05")
    later = without(ball_frame(3, center), "cam09")
    trained = field.fit(SCENE, SETTINGS, first, None, 0, silent)
    tuned = field.fine_tune(SETTINGS, *field.of_common_cameras(trained, first, later), 0, silent)
    cloud = cloud_of(tuned, later)  # looked at by all that took it, also by the one that frame 0 lost
    assert np.median(off_the_ball(cloud, center)) < 0.02
    np.testing.assert_allclose(center_of(cloud) - center_of(cloud_of(trained, first)), [0.08, 0.0, 0.08], atol=0.015)


def source(folder: Path) -> CaptureSource:
    return CaptureSource(kind="capture", path=str(folder))


def a_checkpoint(cameras: int) -> Checkpoint:
    backgrounds = np.arange(cameras)[:, None, None, None] * np.ones((1, 2, 2, 3))
    return Checkpoint(field="grid", frame_index=0, step=1, parent=None, state={"backgrounds": backgrounds}, psnr=30.0)


def test_backgrounds_follow_their_cameras(tmp_path: Path) -> None:
    write_transforms(tmp_path, film(AMPLITUDE, 1))
    frame = capture.open_capture(source(tmp_path)).read(0)
    fewer = capture.split_held_out(frame, 3)[0]  # without cameras 0, 3 and 6
    parent, start, now = field.of_common_cameras(a_checkpoint(8), frame, fewer)
    assert parent.state["backgrounds"][:, 0, 0, 0].tolist() == [1, 2, 4, 5, 7]
    assert [one.name for one in start.rig.cameras] == [one.name for one in now.rig.cameras]
    np.testing.assert_array_equal(start.images, frame.images[[1, 2, 4, 5, 7]])
    same = field.of_common_cameras(a_checkpoint(8), frame, frame)
    assert same[1] is frame


def test_a_camera_that_frame_0_lost_says_nothing_later(tmp_path: Path) -> None:
    write_transforms(tmp_path, film(AMPLITUDE, 1))
    frame = capture.open_capture(source(tmp_path)).read(0)
    fewer = capture.split_held_out(frame, 3)[0]
    parent, start, now = field.of_common_cameras(a_checkpoint(5), fewer, frame)
    assert len(parent.state["backgrounds"]) == len(start.images) == len(now.images) == 5


def test_masked_pixels_show_what_frame_0_showed(tmp_path: Path) -> None:
    write_transforms(tmp_path, film(AMPLITUDE, 2))
    opened = capture.open_capture(source(tmp_path))
    first, now = opened.read(0), opened.read(1)
    counts = np.ones(now.images.shape[:3], dtype=bool)
    counts[2, 10:60] = False
    _, start, seen = field.of_common_cameras(a_checkpoint(8), first, replace(now, counts=counts))
    np.testing.assert_array_equal(seen.images[2, 10:60], start.images[2, 10:60])
    np.testing.assert_array_equal(seen.images[2, 60:], now.images[2, 60:])
    np.testing.assert_array_equal(seen.images[[0, 1, 3]], now.images[[0, 1, 3]])


def test_rays_are_drawn_from_pixels_that_count(tmp_path: Path) -> None:
    write_transforms(tmp_path, film(AMPLITUDE, 1))
    frame = capture.open_capture(source(tmp_path)).read(0)
    counts = np.zeros(frame.images.shape[:3], dtype=bool)
    counts[1, 20:40, 10:15] = True
    counts[6, 3] = True
    drawn = views_of(replace(frame, counts=counts)).drawn(4000, np.random.default_rng(0))
    hits = np.bincount(drawn, minlength=counts.size).reshape(counts.shape)
    assert hits[~counts].sum() == 0
    assert np.abs(hits[counts] - 4000 / counts.sum()).max() < 6 * np.sqrt(4000 / counts.sum())
    whole = views_of(frame).drawn(100, np.random.default_rng(3))
    np.testing.assert_array_equal(whole, np.random.default_rng(3).integers(0, counts.size, 100))


def test_what_a_mask_hides_leaves_no_trace() -> None:
    """Something large stands before one camera, masked: the ball comes out as without it."""
    center = np.array([0.0, 0.0, 0.75])
    frame = ball_frame(0, center)
    images, counts = frame.images.copy(), np.ones(frame.images.shape[:3], dtype=bool)
    images[4, 10:50, 10:50], counts[4, 10:50, 10:50] = [255, 0, 255], False
    masked = replace(frame, images=images, counts=counts)
    trained = field.fit(SCENE, SETTINGS, masked, None, 0, silent)
    cloud = cloud_of(trained, masked)
    near = off_the_ball(cloud, center) < 0.03
    painted = 0.5 + 0.4 * np.sin(6 * (cloud.points[near] - center) / RADIUS)
    assert np.median(off_the_ball(cloud, center)) < 0.02
    assert np.median(np.abs(cloud.colors[near] - painted)) < 0.1
    assert np.quantile(off_the_ball(cloud, center), 0.9) < 0.08
