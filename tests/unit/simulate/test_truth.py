"""The truth is whole: modes, masses, every vertex in every frame, true cameras and depths, and it survives its file."""

from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io, pipeline
from nerfmodal.errors import InvalidInput
from nerfmodal.geometry.cameras import project, semi_spherical_rig
from nerfmodal.simulate import acai, frame_times, true_depths, true_modes, vertices_at
from nerfmodal.spec import ImposedMode, RigSpec, ScanSpec, SimulationSource

MOTION = (
    ImposedMode(organ="leaf_*", shape="bending_1", frequency_hz=2.17, damping_ratio=0.02, amplitude_m=0.05),
    ImposedMode(organ="trunk", shape="bending_1", frequency_hz=1.07, amplitude_m=0.04),
)
SOURCE = SimulationSource(
    kind="simulation",
    frames=5,
    frame_rate_hz=25,
    motion=MOTION,
    coupled=True,
    kinematics="rotation",
    rig=RigSpec(cameras=3, width_px=40, height_px=48),
    depth_maps=True,
)
SPEC = ScanSpec(source=SOURCE)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("truth") / "truth.npz"
    pipeline.write_truth(SPEC, path)
    return path


def test_modes_come_back_with_their_damped_frequency(written):
    modes = io.read_truth(written)
    expected = true_modes(SOURCE, frame_times(SOURCE))
    assert [(mode.organ, mode.name) for mode in modes] == [(mode.organ, mode.name) for mode in expected]
    assert len(modes) == 11
    for mode, imposed in zip(modes, expected, strict=True):
        assert np.array_equal(mode.shape, imposed.shape)
        assert np.array_equal(mode.coordinates, imposed.coordinates)
    assert modes[0].damped_frequency == pytest.approx(2.17 * np.sqrt(1 - 0.02**2))
    with np.load(written) as archive:
        assert archive["damped_frequencies"] == pytest.approx([mode.damped_frequency for mode in modes])


def test_every_vertex_of_every_frame_comes_back(written):
    positions, plant = io.read_positions(written), acai()
    assert positions.shape == (5, len(plant.mesh.vertices), 3)
    for index, time in enumerate(frame_times(SOURCE)):
        assert positions[index] == pytest.approx(vertices_at(plant, SOURCE, float(time)), abs=1e-6)


def test_the_scene_comes_back(written):
    scene, plant = io.read_scene(written), acai()
    assert scene.mesh.organs == plant.mesh.organs
    for name in ("vertices", "triangles", "colors", "organ"):
        assert np.array_equal(getattr(scene.mesh, name), getattr(plant.mesh, name))
    assert np.array_equal(scene.times, frame_times(SOURCE))
    assert scene.modal_masses.shape == (11,)
    assert scene.modal_masses.min() > 0
    for told, true in zip(scene.rig.cameras, semi_spherical_rig(SOURCE.rig).cameras, strict=True):
        assert (told.name, told.width, told.focal_x, told.center_y) == (
            true.name,
            true.width,
            true.focal_x,
            true.center_y,
        )
        assert np.array_equal(told.camera_to_world, true.camera_to_world)


def test_equal_truths_are_equal_files(written, tmp_path):
    pipeline.write_truth(SPEC, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == written.read_bytes()


@pytest.mark.parametrize("read", [io.read_truth, io.read_scene, io.read_positions, io.read_depths])
def test_another_file_is_no_truth(read, tmp_path):
    path = tmp_path / "truth.npz"
    path.write_bytes(b"PK\x03\x04 no zip at all")
    with pytest.raises(InvalidInput, match="no truth file"):
        read(path)


def test_a_truth_cut_short_is_refused(written, tmp_path):
    path = tmp_path / "half.npz"
    path.write_bytes(written.read_bytes()[:-4000])
    with pytest.raises(InvalidInput, match="Simulate the scan again"):
        io.read_scene(path)


def test_depths_are_those_of_the_vertices_that_cameras_see(tmp_path):
    assert pipeline.write_depths(SPEC, 2, tmp_path / "depth.npz")
    depths = io.read_depths(tmp_path / "depth.npz")
    rig, direct = true_depths(SOURCE, 2)
    vertices = vertices_at(acai(), SOURCE, float(frame_times(SOURCE)[2]))
    for camera, map_ in zip(rig.cameras, direct, strict=True):
        assert np.array_equal(depths[camera.name], map_.astype(np.float32))
        pixels, ahead = project(camera, vertices)
        columns, rows = np.floor(pixels).astype(int).T
        inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        # nothing is seen behind a vertex's pixel much farther than the nearest vertex there
        assert np.quantile(map_[rows[inside], columns[inside]] - ahead[inside], 0.5) < 0.05
        assert np.isfinite(map_).mean() > 0.3


def test_the_ground_is_where_the_rays_meet_it():
    rig, direct = true_depths(SOURCE, 0)
    camera, map_ = rig.cameras[-1], direct[-1]
    row, column = camera.height - 1, 0
    local = np.array(
        [(column + 0.5 - camera.center_x) / camera.focal_x, -(row + 0.5 - camera.center_y) / camera.focal_y, -1]
    )
    spot = camera.camera_to_world[:3, 3] + map_[row, column] * camera.camera_to_world[:3, :3] @ local
    assert spot[2] == pytest.approx(0.0, abs=1e-6)


def test_depths_are_written_only_when_asked_for(tmp_path):
    plain = ScanSpec(source=SOURCE.model_copy(update={"depth_maps": False}))
    assert not pipeline.write_depths(plain, 0, tmp_path / "depth.npz")
    assert list(tmp_path.iterdir()) == []
