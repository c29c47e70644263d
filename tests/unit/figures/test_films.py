"""Films say what they are made from: one closed swing, read back frame by frame from MP4 and GIF."""

from pathlib import Path

import av
import numpy as np
import pytest
from nerfmodal.figures import film, write_film
from nerfmodal.figures.encode import FRAMES_PER_SECOND
from nerfmodal.figures.films import FOOT, HEAD, SECONDS, SIZE, SWINGS, screen_of
from nerfmodal.figures.landmarks import limits_around
from nerfmodal.figures.shapes import drawn_mode, reach_of
from nerfmodal.figures.view import far_to_near, light, nice_length, view_across
from PIL import Image

from tests.fixtures.scans import small_result

LEAF, TRUNK = small_result().organs
COUNT = round(SECONDS * FRAMES_PER_SECOND)


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return film(LEAF, 0)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> tuple[Path, Path]:
    return write_film(LEAF, 0, tmp_path_factory.mktemp("films"))


def test_a_film_is_one_swing_that_closes(frames):
    assert frames.shape == (COUNT, SIZE[1], SIZE[0], 3)
    for step in range(1, COUNT // 2):
        np.testing.assert_array_equal(frames[step], frames[-step])
    assert (frames[0] != frames[COUNT // 2]).any()


def test_the_picture_moves_and_its_words_stand_still(frames):
    changed = (frames != frames[0]).any(axis=(0, 3))
    assert changed[HEAD : SIZE[1] - FOOT].any()
    assert not changed[: HEAD - 8].any()
    assert not changed[SIZE[1] - FOOT + 8 :].any()
    assert (frames[0, : HEAD - 8] < 128).any()


@pytest.mark.parametrize(("organ", "k"), [(LEAF, 0), (LEAF, 2), (TRUNK, 0)])
def test_everything_the_mode_reaches_is_on_the_screen(organ, k):
    mode = drawn_mode(organ, k)
    seen = screen_of(mode).project(reach_of([mode])) / 2
    assert seen[:, 0].min() >= 0
    assert seen[:, 0].max() <= SIZE[0]
    assert seen[:, 1].min() >= HEAD - 1
    assert seen[:, 1].max() <= SIZE[1] - FOOT + 1


def test_mp4_is_h264_and_holds_the_swings(written, frames):
    with av.open(str(written[0])) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert (stream.codec_context.name, stream.average_rate) == ("h264", FRAMES_PER_SECOND)
    assert len(pictures) == SWINGS * COUNT
    difference = np.abs(pictures[COUNT].astype(float) - frames[0])
    assert difference.mean() < 3


def test_gif_repeats_for_ever_at_the_same_speed(written, frames):
    with Image.open(written[1]) as animation:
        assert (animation.n_frames, animation.info["loop"]) == (COUNT, 0)
        assert animation.info["duration"] == 1000 / FRAMES_PER_SECOND
        animation.seek(COUNT // 2)
        shown = np.asarray(animation.convert("RGB")).astype(float)
    assert np.abs(shown - frames[COUNT // 2]).mean() < 4


def test_equal_results_give_equal_pictures(written, tmp_path: Path):
    again = write_film(LEAF, 0, tmp_path)
    assert again[1].read_bytes() == written[1].read_bytes()
    assert [path.name for path in again] == ["leaf_0_mode_0.mp4", "leaf_0_mode_0.gif"]


def test_a_view_keeps_lengths_and_looks_across_the_motion():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 3)) * [1, 0.1, 0.01]
    view = view_across(points, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
    assert abs(view.axes[2, 0]) < 0.5  # the length is seen from the side
    assert view.project(np.array([[0.0, 0, 1]]))[0, 1] > 0.85  # up is up


def test_limits_hold_everything_and_leave_a_corner_below():
    seen = np.random.default_rng(3).uniform((1, 2), (3, 8), (200, 2))
    low, high = limits_around(seen, room=0.3)
    assert (low < seen.min(axis=0)).all()
    assert (high > seen.max(axis=0)).all()
    assert seen[:, 1].min() - low[1] > 0.3 * 2
    flat = limits_around(np.array([[0.0, 1.0], [4.0, 1.0]]))
    assert (flat[1] - flat[0]).min() > 0.9


def test_near_faces_are_painted_last_and_flat_ones_are_brightest():
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    flat, steep = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 5], [1, 0, 5], [0, 0.1, 6]]
    corners = np.array([steep, flat], dtype=float)
    assert far_to_near(corners).tolist() == [1, 0]
    brightness = light(corners, triangles)
    assert brightness[1] == pytest.approx(1.0)
    assert brightness[0] < 0.85


@pytest.mark.parametrize(("longest", "nice"), [(0.26, 0.2), (1.0, 1.0), (7.3, 5.0), (0.0099, 0.005)])
def test_scale_bars_are_round(longest, nice):
    assert nice_length(longest) == pytest.approx(nice)
