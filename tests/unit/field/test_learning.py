"""Fields learn small scenes: a ball over a floor, seen by a ring of cameras, and the ball after it moved."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.cloud import extract
from nerfmodal.errors import TrainingDiverged
from nerfmodal.field import Scene, fine_tune, fit, looker
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.geometry.rays import rig_directions
from nerfmodal.io import ResumeFile
from nerfmodal.spec import ReconstructionSpec, RigSpec
from nerfmodal.types import Checkpoint, Frame, PointCloud

RADIUS = 0.3
SCENE = Scene(low=np.array([-0.7, -0.7, 0.05]), high=np.array([0.7, 0.7, 1.45]), ground=np.zeros(3))
SETTINGS = ReconstructionSpec(voxel_m=0.04, iterations=260, fine_tune_iterations=80, rays_per_batch=2048, points=4000)


def ball_frame(index: int, center: np.ndarray, cameras: int = 14) -> Frame:
    """A ball with a painted surface over a checkered floor under a plain sky, ray-traced exactly."""
    rig = semi_spherical_rig(
        RigSpec(cameras=cameras, width_px=64, height_px=64, radius_m=2.2, target_m=(0, 0, 0.7), field_of_view_deg=55)
    )
    images = np.empty((cameras, 64 * 64, 3))
    for camera, directions, image in zip(rig.cameras, rig_directions(rig), images, strict=True):
        origin = camera.camera_to_world[:3, 3]
        b = directions @ (origin - center)
        inside = b**2 - ((origin - center) ** 2).sum() + RADIUS**2
        t = -b - np.sqrt(np.maximum(inside, 0))
        normal = (origin + t[:, None] * directions - center) / RADIUS
        ball = 0.5 + 0.4 * np.sin(6 * normal)
        ground = origin - origin[2] / np.minimum(directions[:, 2], -1e-3)[:, None] * directions
        squares = (np.floor(ground[:, 0] / 0.4) + np.floor(ground[:, 1] / 0.4)) % 2
        floor = np.repeat(0.3 + 0.3 * squares[:, None], 3, axis=1)
        beyond = np.where(directions[:, 2:] < -1e-3, floor, [0.6, 0.75, 0.95])
        image[:] = np.where((inside > 0)[:, None], ball, beyond)
    shaped = np.round(np.clip(images, 0, 1) * 255).astype(np.uint8).reshape(cameras, 64, 64, 3)
    return Frame(index=index, time=index / 30, images=shaped, rig=rig)


def silent(done: int, total: int, message: str) -> None:
    del done, total, message


@pytest.fixture(scope="module")
def first() -> Frame:
    return ball_frame(0, np.array([0.0, 0.0, 0.75]))


@pytest.fixture(scope="module")
def trained(first: Frame) -> Checkpoint:
    return fit(SCENE, SETTINGS, first, None, 0, silent)


def cloud_of(checkpoint: Checkpoint, frame: Frame) -> PointCloud:
    return extract(
        looker(checkpoint, frame),
        frame,
        SCENE.low,
        SCENE.high,
        threshold=0.5,
        spread=0.12,
        count=4000,
        rng=np.random.default_rng(0),
        report=lambda *_: None,
    )


def off_the_ball(cloud: PointCloud, center: np.ndarray) -> np.ndarray:
    return np.abs(np.linalg.norm(cloud.points - center, axis=1) - RADIUS)


def center_of(cloud: PointCloud) -> np.ndarray:
    """Centre of the sphere through the points: |p|^2 = 2 c p + constant, by least squares, twice without outliers."""
    points = cloud.points
    for _ in range(3):
        model = np.column_stack([2 * points, np.ones(len(points))])
        solution, *_ = np.linalg.lstsq(model, (points**2).sum(axis=1), rcond=None)
        points = cloud.points[off_the_ball(cloud, solution[:3]) < 0.06]
    return np.asarray(solution[:3])


def test_the_ball_is_found_without_a_mask(trained: Checkpoint, first: Frame) -> None:
    distances = off_the_ball(cloud_of(trained, first), np.array([0.0, 0.0, 0.75]))
    assert len(distances) > 500
    assert np.median(distances) < 0.02  # half a voxel; a pixel is 36 mm
    assert np.quantile(distances, 0.9) < 0.08


@pytest.mark.parametrize("cameras", [6, 9])
def test_few_cameras_do_not_learn_the_ball_as_a_picture_of_the_floor(cameras: int) -> None:
    """Much of the floor and all of the sky are seen by one camera alone: the ball before them might be their paint."""
    center = np.array([0.0, 0.0, 0.75])
    frame = ball_frame(0, center, cameras)
    checkpoint = fit(SCENE, SETTINGS, frame, None, 0, silent)
    distances = off_the_ball(cloud_of(checkpoint, frame), center)
    assert len(distances) > 500
    assert np.median(distances) < 0.02
    assert np.quantile(distances, 0.9) < 0.04
    known, behind = checkpoint.state["backgrounds_known"], checkpoint.state["backgrounds"]
    sure = np.abs(behind[known].astype(int) - ball_frame(0, np.array([0.0, 0.0, 1e3]), cameras).images[known])
    assert np.quantile(sure, 0.98) < 60  # squares of the floor differ by 76, the ball by up to 230


def test_a_moved_ball_is_found_where_it_is(trained: Checkpoint, first: Frame) -> None:
    center = np.array([0.08, 0.0, 0.83])
    frame = ball_frame(3, center)
    tuned = fine_tune(SETTINGS, trained, first, frame, 0, silent)
    cloud = cloud_of(tuned, frame)
    assert tuned.parent == 0
    assert np.median(off_the_ball(cloud, center)) < 0.02
    shift = center_of(cloud) - center_of(cloud_of(trained, first))
    np.testing.assert_allclose(shift, [0.08, 0.0, 0.08], atol=0.01)  # no ghost holds it back


def test_an_unchanged_frame_keeps_its_field(trained: Checkpoint, first: Frame) -> None:
    tuned = fine_tune(SETTINGS, trained, first, replace(first, index=5), 0, silent)
    np.testing.assert_array_equal(cloud_of(tuned, first).points, cloud_of(trained, first).points)


def test_the_same_seed_gives_the_same_field(trained: Checkpoint, first: Frame) -> None:
    frame = ball_frame(2, np.array([0.05, 0.0, 0.75]))
    one, other = (fine_tune(SETTINGS, trained, first, frame, 4, silent) for _ in range(2))
    np.testing.assert_array_equal(one.state["values"], other.state["values"])


def test_views_held_out_are_measured(first: Frame) -> None:
    settings = SETTINGS.model_copy(update={"iterations": 60})
    checkpoint = fit(SCENE, settings, first, first, 0, silent)
    assert checkpoint.held_out_psnr is not None
    assert checkpoint.held_out_psnr > 12


def test_a_loss_that_is_no_number_is_an_error(first: Frame) -> None:
    settings = SETTINGS.model_copy(
        update={"field": "mlp", "mlp_width": 8, "learning_rate": 1e30, "iterations": 5, "rays_per_batch": 64}
    )
    with pytest.raises(TrainingDiverged, match="loss became"):
        fit(SCENE, settings, first, None, 0, silent)


def test_without_ground_the_ball_is_found_and_an_outer_grid_explains_the_rest(first: Frame) -> None:
    scene = Scene(low=SCENE.low, high=SCENE.high, ground=None)
    settings = SETTINGS.model_copy(update={"iterations": 160})
    checkpoint = fit(scene, settings, first, None, 0, silent, alone=True)
    assert checkpoint.state["outer"].size > 0
    assert "backgrounds" not in checkpoint.state
    assert checkpoint.psnr > 20
    distances = off_the_ball(cloud_of(checkpoint, first), np.array([0.0, 0.0, 0.75]))
    assert len(distances) > 500
    assert np.median(distances) < 0.02


def test_a_very_short_training_is_faint_but_not_empty(first: Frame) -> None:
    checkpoint = fit(SCENE, SETTINGS.model_copy(update={"iterations": 12}), first, None, 0, silent)
    assert len(checkpoint.state["masks"]) > 0


def test_the_papers_network_learns(first: Frame) -> None:
    settings = SETTINGS.model_copy(
        update={
            "field": "mlp",
            "mlp_width": 32,
            "coarse_samples": 16,
            "fine_samples": 16,
            "iterations": 30,
            "rays_per_batch": 256,
            "learning_rate": 5e-3,
        }
    )
    heard: list[str] = []
    checkpoint = fit(SCENE, settings, first, None, 0, lambda *said: heard.append(said[2]))
    again = fit(SCENE, settings, first, None, 0, silent)
    tuned = fine_tune(settings.model_copy(update={"fine_tune_iterations": 3}), checkpoint, first, first, 0, silent)
    decibels = [float(message.split("PSNR ")[1].split()[0]) for message in heard]
    assert decibels[-1] > decibels[0] + 1
    np.testing.assert_array_equal(checkpoint.state["fine.layers.0.weight"], again.state["fine.layers.0.weight"])
    assert tuned.step == 33
    colors, opacity, distance, spread = looker(tuned, first)(np.array([[0, 32, 32], [3, 30, 30]], np.int32))
    assert ((colors >= 0) & (colors <= 1)).all()
    assert ((opacity >= 0) & (opacity <= 1)).all()
    assert np.isfinite(distance).all()
    assert (spread >= 0).all()


PAPER = SETTINGS.model_copy(
    update={
        "field": "mlp",
        "mlp_width": 16,
        "coarse_samples": 8,
        "fine_samples": 8,
        "iterations": 12,
        "fine_tune_iterations": 6,
        "rays_per_batch": 64,
        "learning_rate": 5e-3,
    }
)


class Stopped(Exception):
    """Somebody asked to stop."""


def stop_at(iteration: int) -> Callable[[int, int, str], None]:
    def told(done: int, total: int, message: str) -> None:
        del total, message
        if done == iteration:
            raise Stopped

    return told


def assert_equal_states(one: Checkpoint, other: Checkpoint) -> None:
    assert one.state.keys() == other.state.keys()
    for name, values in one.state.items():
        np.testing.assert_array_equal(values, other.state[name], err_msg=name)


def test_a_stopped_training_of_the_papers_network_goes_on_to_the_same_bits(first: Frame, tmp_path: Path) -> None:
    file = tmp_path / "training.safetensors"
    with pytest.raises(Stopped):
        fit(SCENE, PAPER, first, None, 0, stop_at(7), ResumeFile(file))
    heard: list[int] = []
    resumed = fit(SCENE, PAPER, first, None, 0, lambda done, *_: heard.append(done), ResumeFile(file))
    assert heard[0] == 8
    assert_equal_states(resumed, fit(SCENE, PAPER, first, None, 0, silent))


def test_a_stopped_training_of_the_grid_goes_on_from_its_last_level(first: Frame, tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"iterations": 60, "rays_per_batch": 512})
    file = tmp_path / "training.safetensors"
    with pytest.raises(Stopped):
        fit(SCENE, settings, first, None, 0, stop_at(40), ResumeFile(file, every_s=0.0))
    heard: list[int] = []
    resumed = fit(SCENE, settings, first, None, 0, lambda done, *_: heard.append(done), ResumeFile(file))
    assert 12 < heard[0] <= 40  # the first fifth is the background
    assert_equal_states(resumed, fit(SCENE, settings, first, None, 0, silent))


def test_the_state_of_another_training_is_not_taken_up(tmp_path: Path) -> None:
    file = ResumeFile(tmp_path / "training.safetensors")
    file.training = "one"
    file.keep({"values": np.zeros(3)})
    other = ResumeFile(tmp_path / "training.safetensors")
    other.training = "other"
    assert other.taken_up() is None
    (tmp_path / "training.safetensors").write_bytes(b"broken")
    assert file.taken_up() is None


def test_a_further_frame_of_the_papers_network_stops_when_its_surface_rests(first: Frame) -> None:
    parent = fit(SCENE, PAPER, first, None, 0, silent)
    frame = ball_frame(3, np.array([0.08, 0.0, 0.83]))
    settings = PAPER.model_copy(update={"fine_tune_iterations": 40, "settled_m": 100.0})
    eager = fine_tune(settings, parent, first, frame, 0, silent)
    patient = fine_tune(settings.model_copy(update={"settled_m": 1e-9}), parent, first, frame, 0, silent)
    assert eager.step < patient.step == parent.step + 40
