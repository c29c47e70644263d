"""The arithmetic of `benchmarks.nerfacto`, and that what it hands to nerfstudio are the same pictures and rays."""

import json

import numpy as np
import pytest
from nerfmodal.geometry.cameras import focus_of, look_at, project
from nerfmodal.io.transforms import parse_camera
from nerfmodal.spec import CloudsSource, ScanSpec
from nerfmodal.types import Camera, Frame, Rig
from PIL import Image

from benchmarks.nerfacto import Moment, Task, compared_pixels, read_moments, speed_up, time_to_reach, write_capture


def curve(*points: tuple[float, float]) -> list[Moment]:
    return [Moment(seconds=seconds, psnr=psnr) for seconds, psnr in points]


NERFACTO = curve((10, 12), (30, 16), (60, 15), (100, 18))


@pytest.mark.parametrize(("target", "seconds"), [(12, 10), (14, 20), (16, 30), (17, 260 / 3), (18, 100), (11, 10)])
def test_a_curve_reaches_a_value_where_it_first_crosses_it(target: float, seconds: float):
    assert time_to_reach(NERFACTO, target) == pytest.approx(seconds)


def test_a_curve_that_stays_below_never_reaches_it():
    assert time_to_reach(NERFACTO, 18.01) is None
    assert time_to_reach([], 1) is None


def test_the_speed_up_is_their_time_over_that_of_our_first_fit_that_is_as_good():
    fits = curve((0.2, 14), (0.5, 17.9), (1.0, 18.4), (2.0, 21))
    assert speed_up(NERFACTO, fits) == pytest.approx(100)


def test_the_clock_of_a_curve_that_was_better_before_stops_when_it_first_was_as_good_as_at_the_end():
    assert speed_up(curve((10, 12), (20, 18), (100, 15)), curve((1, 15))) == pytest.approx(15)


def test_there_is_no_speed_up_where_ours_never_gets_there():
    assert speed_up(NERFACTO, curve((0.2, 14), (9.0, 17.9))) == 0.0


@pytest.mark.parametrize("shape", [(7, 480, 270, 3), (3, 200, 200, 3)])
def test_compared_pixels_are_in_the_pictures_differ_and_spread(shape: tuple[int, ...]):
    pixels = compared_pixels(shape)
    assert (pixels >= 0).all()
    assert (pixels < shape[:3]).all()
    assert len(np.unique(pixels, axis=0)) == len(pixels)
    assert np.bincount(pixels[:, 0]).tolist() == [len(pixels) // shape[0]] * shape[0]
    np.testing.assert_allclose(pixels[:, 1:].mean(axis=0), [(shape[1] - 1) / 2, (shape[2] - 1) / 2], atol=1)


def test_what_nerfacto_gets_shows_every_point_where_ours_does(tmp_path):
    rng = np.random.default_rng(0)
    frame = Frame(
        index=0,
        time=0.0,
        images=rng.integers(0, 256, (6, 20, 30, 3), dtype=np.uint8),
        rig=Rig(cameras=tuple(camera(index, rng) for index in range(6))),
    )
    learned, held_out = some(frame, range(1, 6)), some(frame, range(1))
    spec = ScanSpec(source=CloudsSource(kind="clouds", path="nowhere"))
    pixels = np.array([[0, 3, 4], [0, 19, 29]])
    write_capture(Task(name="six", spec=spec, learned=learned, held_out=held_out, pixels=pixels), tmp_path)
    written = json.loads((tmp_path / "transforms.json").read_text())
    entries = {entry["file_path"]: entry for entry in written["frames"]}
    assert sorted(entries) == sorted(written["train_filenames"] + written["val_filenames"])
    np.testing.assert_array_equal(np.load(tmp_path / "held_out.npy"), pixels)
    center, _ = focus_of(learned.rig)
    points = center + rng.normal(scale=0.2, size=(20, 3))
    reach = max(np.abs(one.camera_to_world[:3, 3] - center).max() for one in frame.rig.cameras)
    for names, part in ((written["train_filenames"], learned), (written["val_filenames"], held_out)):
        for name, own, image in zip(names, part.rig.cameras, part.images, strict=True):
            theirs = parse_camera(entries[name], written, name)
            assert np.abs(theirs.camera_to_world[:3, 3]).max() <= 1 + 1e-12
            np.testing.assert_allclose(project(theirs, (points - center) / reach)[0], project(own, points)[0])
            np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / name)), image)


def camera(index: int, rng: np.random.Generator) -> Camera:
    place = np.array([4 * np.cos(index), 4 * np.sin(index), 1.0 + 0.3 * index])
    return Camera(
        name=f"camera{index}",
        width=30,
        height=20,
        focal_x=25 + rng.uniform(),
        focal_y=26.0,
        center_x=15.3,
        center_y=9.8,
        camera_to_world=look_at(place, np.array([0.4, -0.2, 0.9])),
        model="opencv",
        distortion=(0.05, -0.08, 0.0, 0.0, -0.001, 0.0002),
    )


def some(frame: Frame, chosen: range) -> Frame:
    return Frame(
        index=frame.index,
        time=frame.time,
        images=frame.images[chosen.start : chosen.stop],
        rig=Rig(cameras=frame.rig.cameras[chosen.start : chosen.stop]),
    )


def test_a_run_that_goes_on_from_an_earlier_state_replaces_what_was_lost(tmp_path):
    log = tmp_path / "moments.jsonl"
    told = [(1, 10.0), (2, 11.0), (4, 12.0), (3, 11.5), (5, 13.0)]
    lines = [json.dumps({"seconds": seconds, "psnr": psnr, "rays": 7, "steps": 1}) for seconds, psnr in told]
    log.write_text("\n".join(["Caching all 3 images.", *lines]))
    assert read_moments(log) == [Moment(seconds=s, psnr=p, rays=7) for s, p in ((1, 10), (2, 11), (3, 11.5), (5, 13))]
