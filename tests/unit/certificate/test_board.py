"""The board: before every rig, clear of the ground, its motion along its normal, its lines apart from one another."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.certificate import Settings, board_before, certify, moved, rig_digest
from nerfmodal.certificate.target import AMPLITUDES, FREQUENCIES, SHAPES, true_modes
from nerfmodal.errors import InvalidInput
from nerfmodal.geometry.cameras import look_at, project, semi_spherical_rig
from nerfmodal.geometry.frames import frame_of_box
from nerfmodal.spec import RigSpec
from nerfmodal.types import Rig

TIMES = np.arange(48) / 30.0
AROUND = semi_spherical_rig(RigSpec(cameras=12, width_px=320, height_px=240, radius_m=2.5))
LOW = semi_spherical_rig(RigSpec(cameras=12, radius_m=1.0, target_m=(3.0, -2.0, 0.1)))


def beside() -> Rig:
    """Six cameras in a row that look along +y, as before a wall."""
    [first, *_] = AROUND.cameras
    places = [np.array([x, -3.0, 1.0]) for x in np.linspace(-1, 1, 6)]
    target = np.array([0.0, 0.0, 1.0])
    return Rig(cameras=tuple(replace(first, camera_to_world=look_at(place, target)) for place in places))


RIGS = {"around": AROUND, "low": LOW, "beside": beside()}


@pytest.mark.parametrize("name", RIGS)
def test_every_camera_sees_the_whole_board_at_all_times(name: str):
    board = board_before(RIGS[name], np.random.default_rng(0), 160)
    modes = true_modes(board, 30.0, TIMES)
    assert board.mesh.vertices[:, 2].min() > 0
    for frame in (0, 7):
        for camera in board.rig.cameras:
            pixels, depths = project(camera, moved(board, modes, frame))
            assert (depths > 0).all()
            assert ((pixels > 0) & (pixels < [camera.width, camera.height])).all()


@pytest.mark.parametrize("name", RIGS)
def test_the_blades_face_the_cameras_and_stay_in_their_boxes(name: str):
    board = board_before(RIGS[name], np.random.default_rng(0), 160)
    middle = np.mean([camera.camera_to_world[:3, 3] for camera in board.rig.cameras], axis=0)
    towards = middle - board.mesh.vertices.mean(axis=0)
    assert board.normal @ towards / np.linalg.norm(towards) > 0.95
    modes = true_modes(board, 30.0, TIMES)
    vertices = moved(board, modes, 0)
    for blade, box in enumerate(board.regions):
        local = frame_of_box(box).to_local(vertices[board.mesh.organ == blade])
        assert (np.abs(local) <= np.array(box.size_m) / 2).all()


def test_lines_are_apart_and_each_frequency_meets_every_shape():
    sums = [a + b for a in FREQUENCIES for b in FREQUENCIES] + [abs(a - b) for a in FREQUENCIES for b in FREQUENCIES]
    assert min(abs(one - line) for one in sums for line in FREQUENCIES) > 0.02
    assert max(FREQUENCIES) < 0.45
    board = board_before(AROUND, np.random.default_rng(0), 160)
    modes = true_modes(board, 30.0, TIMES)
    for frequency in FREQUENCIES:
        assert {mode.name for mode in modes if mode.frequency == pytest.approx(30 * frequency)} == set(SHAPES)


def test_amplitudes_are_those_of_the_ladder_along_the_normal():
    board = board_before(AROUND, np.random.default_rng(0), 160)
    for mode in true_modes(board, 30.0, TIMES):
        blade = board.mesh.organs.index(mode.organ)
        assert np.linalg.norm(mode.shape, axis=1).max() == pytest.approx(1.0)
        assert np.linalg.norm(np.cross(mode.shape, board.normal), axis=1).max() < 1e-9
        assert np.abs(mode.coordinates).max() <= AMPLITUDES[blade] * board.grain


def test_the_digest_is_that_of_the_rig_alone():
    renamed = Rig(cameras=tuple(replace(camera, name=f"x{k}") for k, camera in enumerate(reversed(AROUND.cameras))))
    assert rig_digest(renamed, 30.0) == rig_digest(AROUND, 30.0)
    assert rig_digest(AROUND, 25.0) != rig_digest(AROUND, 30.0)
    pose = AROUND.cameras[0].camera_to_world.copy()
    pose[0, 3] += 1e-4
    shifted = Rig(cameras=(replace(AROUND.cameras[0], camera_to_world=pose), *AROUND.cameras[1:]))
    assert rig_digest(shifted, 30.0) != rig_digest(AROUND, 30.0)


def test_a_trial_that_cannot_be_is_refused():
    two = Rig(cameras=AROUND.cameras[:2])
    with pytest.raises(InvalidInput, match="2 cameras"):
        certify(two, Settings(frame_rate=30.0), report=lambda _a, _b: None)
    with pytest.raises(InvalidInput, match="too few"):
        certify(AROUND, Settings(frame_rate=30.0, frames=20), report=lambda _a, _b: None)
