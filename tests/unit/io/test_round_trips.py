"""What is written is read back equal, and a write that fails leaves what was there before."""

from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io
from nerfmodal.errors import InvalidCapture, InvalidInput
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.spec import RigSpec
from nerfmodal.types import (
    Checkpoint,
    DisplacementMatrix,
    Frame,
    ModalModel,
    ModeQuality,
    Opinion,
    OrganResult,
    Outcome,
    PointCloud,
    Provenance,
    Reason,
    Reduction,
    ScanResult,
    SensorGrid,
    TrueMode,
    Verdict,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def a_result(rng: np.random.Generator) -> ScanResult:
    shapes = rng.normal(size=(5, 1, 2))
    displacement = DisplacementMatrix.of_values(
        rng.normal(size=(20, 5, 1)),
        directions=np.eye(3)[2:],
        times=np.arange(20) / 30,
        frame_rate=30.0,
        sensors=SensorGrid(organ="leaf", positions=rng.normal(size=(5, 3))),
        valid=np.ones(20, dtype=bool),
    )
    quality = ModeQuality(
        energy_share=0.5, mpc=1.0, mac_between_methods=None, verdict=Verdict.DOUBTFUL, reasons=(Reason.WEAK,)
    )
    model = ModalModel(
        frequencies=np.array([2.0, 5.0]),
        frequency_stds=np.array([0.1, 0.2]),
        damping_ratios=np.array([0.01, 0.02]),
        damping_stds=np.array([0.001, 0.002]),
        mode_shapes=shapes,
        coordinates=rng.normal(size=(20, 2)),
        quality=(quality, quality),
    )
    reduction = Reduction(
        components=rng.normal(size=(5, 2)),
        scores=rng.normal(size=(20, 2)),
        singular_values=np.array([2.0, 1.0]),
        mean=np.zeros(5),
    )
    opinion = Opinion(
        method="complexity_pursuit",
        frequencies=np.array([2.0]),
        damping_ratios=np.array([0.01]),
        mode_shapes=shapes[:, :, :1],
        coordinates=rng.normal(size=(20, 1)),
    )
    organ = OrganResult(
        organ="leaf",
        surface="polynomial",
        displacement=displacement,
        reduction=reduction,
        model=model,
        opinions=(opinion,),
    )
    provenance = Provenance(package_version="0", spec_digest="0", seed=0, device="cpu", started="then", finished="now")
    return ScanResult(
        organs=(organ,),
        times=np.arange(20) / 30,
        frame_rate=30.0,
        excitation="free_decay",
        provenance=provenance,
        outcome=Outcome.NO_MOTION,
    )


DEVICE = "cuda (a GPU), mixed float16"


def test_a_result_survives(tmp_path: Path, rng: np.random.Generator) -> None:
    result = a_result(rng)
    io.write_result(tmp_path / "result.npz", result)
    back = io.read_result(tmp_path / "result.npz")
    assert back.outcome is Outcome.NO_MOTION
    assert back.organs[0].model.quality == result.organs[0].model.quality
    assert back.organs[0].opinions[0].method == "complexity_pursuit"
    np.testing.assert_array_equal(back.organs[0].model.mode_shapes, result.organs[0].model.mode_shapes)
    np.testing.assert_array_equal(back.organs[0].displacement.valid, result.organs[0].displacement.valid)
    assert back.organs[0].reduction is not None


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"no archive"], ids=["empty", "cut", "other"])
def test_what_is_no_result_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "result.npz"
    path.write_bytes(content)
    with pytest.raises(InvalidInput) as refusal:
        io.read_result(path)
    assert refusal.value.where == str(path)


def test_a_frame_survives_to_the_last_pixel(tmp_path: Path, rng: np.random.Generator) -> None:
    rig = semi_spherical_rig(RigSpec(cameras=3, width_px=20, height_px=16))
    images = rng.integers(0, 256, size=(3, 16, 20, 3), dtype=np.uint8)
    io.write_frame(tmp_path / "frame.zip", Frame(index=7, time=0.7 / 3, images=images, rig=rig))
    back = io.read_frame(tmp_path / "frame.zip")
    assert (back.index, back.time) == (7, 0.7 / 3)
    np.testing.assert_array_equal(back.images, images)
    np.testing.assert_array_equal(back.rig.cameras[2].camera_to_world, rig.cameras[2].camera_to_world)


def test_equal_frames_are_equal_files(tmp_path: Path) -> None:
    rig = semi_spherical_rig(RigSpec(cameras=3, width_px=16, height_px=16))
    frame = Frame(index=0, time=0.0, images=np.zeros((3, 16, 16, 3), np.uint8), rig=rig)
    io.write_frame(tmp_path / "one.zip", frame)
    io.write_frame(tmp_path / "other.zip", frame)
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "other.zip").read_bytes()


def test_a_broken_frame_is_named(tmp_path: Path) -> None:
    (tmp_path / "frame.zip").write_bytes(b"PK")
    with pytest.raises(InvalidCapture, match=r"frame\.zip"):
        io.read_frame(tmp_path / "frame.zip")


def test_a_checkpoint_survives(tmp_path: Path, rng: np.random.Generator) -> None:
    state = {"weights": rng.normal(size=(3, 2)).astype(np.float32)}
    checkpoint = Checkpoint(field="grid", frame_index=4, step=60, parent=0, state=state, psnr=30.25, device=DEVICE)
    io.write_checkpoint(tmp_path / "c.safetensors", checkpoint)
    back = io.read_checkpoint(tmp_path / "c.safetensors")
    assert (back.parent, back.psnr, back.held_out_psnr, back.step, back.device) == (0, 30.25, None, 60, DEVICE)
    np.testing.assert_array_equal(back.state["weights"], state["weights"])


def test_no_checkpoint_is_no_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "c.safetensors").write_bytes(b"nothing")
    with pytest.raises(InvalidInput, match=r"c\.safetensors"):
        io.read_checkpoint(tmp_path / "c.safetensors")


def test_a_cloud_survives(tmp_path: Path, rng: np.random.Generator) -> None:
    colors = rng.integers(0, 256, size=(9, 3)) / 255
    cloud = PointCloud(
        points=rng.normal(size=(9, 3)), colors=colors, time=1 / 3, outcome=Outcome.FEW_POINTS, device=DEVICE
    )
    io.write_cloud(tmp_path / "frame_0000.ply", cloud)
    back = io.read_cloud(tmp_path / "frame_0000.ply")
    assert (back.time, back.outcome, back.device) == (1 / 3, Outcome.FEW_POINTS, DEVICE)
    np.testing.assert_array_equal(back.points, cloud.points)
    np.testing.assert_allclose(back.colors, colors, atol=1e-12)


def test_the_precision_of_material_points_survives(tmp_path: Path, rng: np.random.Generator) -> None:
    stds = np.array([1e-3, np.inf, 2e-4])
    cloud = PointCloud(points=rng.normal(size=(3, 3)), colors=np.full((3, 3), 0.5), time=0.0, stds=stds)
    io.write_cloud(tmp_path / "frame_0000.ply", cloud)
    back = io.read_cloud(tmp_path / "frame_0000.ply").stds
    assert back is not None
    np.testing.assert_allclose(back, stds, rtol=1e-6)


def test_an_empty_cloud_survives(tmp_path: Path) -> None:
    cloud = PointCloud(points=np.empty((0, 3)), colors=np.empty((0, 3)), time=0.0, outcome=Outcome.EMPTY_FIELD)
    io.write_cloud(tmp_path / "frame_0000.ply", cloud)
    assert io.read_cloud(tmp_path / "frame_0000.ply").points.shape == (0, 3)


def test_the_truth_survives(tmp_path: Path, rng: np.random.Generator) -> None:
    mode = TrueMode(
        organ="leaf_0",
        name="bending_1",
        frequency=2.0,
        damping_ratio=0.01,
        points=rng.normal(size=(4, 3)),
        shape=rng.normal(size=(4, 3)),
        coordinates=rng.normal(size=6),
    )
    io.write_truth(tmp_path / "truth.npz", [mode])
    (back,) = io.read_truth(tmp_path / "truth.npz")
    assert (back.organ, back.name, back.frequency) == ("leaf_0", "bending_1", 2.0)
    np.testing.assert_array_equal(back.shape, mode.shape)


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    with pytest.raises(RuntimeError), io.atomic_write(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
