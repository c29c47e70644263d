"""Captures written and reconstructed, specifications around a path, and results compared."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal import io, pipeline
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.identify.comparison import modes_as_truth
from nerfmodal.io.transforms import parse_camera
from nerfmodal.pipeline import Progress
from nerfmodal.spec import CloudsSource, RigSpec, ScanSpec
from nerfmodal.types import Checkpoint, Frame, PointCloud
from PIL import Image

from services.cli.local import scan_name, spec_around
from tests.fixtures.scans import small_result
from tests.unit.cli.conftest import Call, stored

RIG = semi_spherical_rig(RigSpec(cameras=3, width_px=16, height_px=16))


def frame(index: int) -> Frame:
    images = np.random.default_rng(index).integers(0, 255, (3, 16, 16, 3)).astype(np.uint8)
    return Frame(index=index, time=index / 30, images=images, rig=RIG)


def cloud(index: int) -> PointCloud:
    points = np.random.default_rng(index).normal(size=(20, 3))
    return PointCloud(points=points, colors=np.full((20, 3), 0.5), time=index / 30)


def checkpoint(index: int, parent: int | None) -> Checkpoint:
    return Checkpoint(field="grid", frame_index=index, step=1, parent=parent, state={}, psnr=30.0 + index)


@pytest.fixture
def fake_stages(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stages that give known values; the list says which were asked for."""
    asked: list[str] = []

    def truth(_: ScanSpec, path: Path) -> None:
        io.write_truth(path, [mode for organ in small_result().organs for mode in modes_as_truth(organ)])

    def first(_: ScanSpec, __: Frame, *, report: Any, alone: bool) -> Checkpoint:  # noqa: ARG001
        report(Progress(done=1, total=1))
        asked.append("first")
        return checkpoint(0, None)

    def tune(_: ScanSpec, parent: Checkpoint, zero: Frame, now: Frame, *, report: Any) -> Checkpoint:  # noqa: ARG001
        assert (parent.parent, zero.index) == (None, 0)
        asked.append(f"tune {now.index}")
        return checkpoint(now.index, 0)

    monkeypatch.setattr(pipeline, "open_source", lambda *_, report: None)  # noqa: ARG005
    monkeypatch.setattr(pipeline, "check_source", lambda *_, report=None: None)  # noqa: ARG005
    monkeypatch.setattr(pipeline, "frame_times", lambda *_: (0.0, 1 / 30, 2 / 30))
    monkeypatch.setattr(pipeline, "make_frame", lambda _, index, *__, report: frame(index))  # noqa: ARG005
    monkeypatch.setattr(pipeline, "write_truth", truth)
    monkeypatch.setattr(pipeline, "fit_first", first)
    monkeypatch.setattr(pipeline, "fine_tune", tune)
    monkeypatch.setattr(pipeline, "extract", lambda _, tuned, now, *, report: cloud(now.index))  # noqa: ARG005
    return asked


def test_simulate_writes_a_capture_that_says_everything(call: Call, spec: Path, fake_stages: list[str]) -> None:  # noqa: ARG001
    done = call("simulate", spec, "--out", "cap", "--json")
    assert (done.exit_code, json.loads(done.stdout)["frames"]) == (0, 3)
    document = stored(spec.parent / "cap/transforms.json")
    assert document["frame_rate_hz"] == 30
    assert len(document["frames"]) == 9
    for entry in document["frames"]:
        camera = parse_camera(entry, document, "cap")
        k, index = int(entry["frame_index"]), [one.name for one in RIG.cameras].index(camera.name)
        np.testing.assert_allclose(camera.camera_to_world, RIG.cameras[index].camera_to_world)
        with Image.open(spec.parent / "cap" / entry["file_path"]) as picture:
            np.testing.assert_array_equal(np.asarray(picture), frame(k).images[index])
        assert entry["time_s"] == pytest.approx(k / 30)
    summary = stored(spec.parent / "cap/truth.json")
    assert summary[0]["frequency_hz"] == pytest.approx(2.17)
    assert len(io.read_truth(spec.parent / "cap/truth.npz")) == len(summary)


def test_only_a_simulation_can_be_simulated(call: Call, spec: Path) -> None:
    spec.write_text("source: {kind: clouds, path: x}\n")
    done = call("simulate", spec)
    assert done.exit_code == 3
    assert "/source/kind" in done.stderr


def test_reconstruct_writes_clouds_that_identify_reads(call: Call, tmp_path: Path, fake_stages: list[str]) -> None:
    (tmp_path / "cap").mkdir()
    done = call("reconstruct", "cap", "--out", "clouds")
    assert done.exit_code == 0, done.output
    assert fake_stages == ["first", "tune 0", "tune 1", "tune 2"]
    clouds = io.open_clouds(tmp_path / "clouds")
    read = list(clouds)
    assert clouds.frame_rate == pytest.approx(30)
    for k in range(3):
        np.testing.assert_allclose(read[k].points, cloud(k).points)
        assert read[k].time == pytest.approx(k / 30)
    metrics = stored(tmp_path / "clouds/metrics.json")
    assert [row["psnr_db"] for row in metrics] == [30, 31, 32]


def test_a_path_names_the_scan_and_a_file_fills_in_the_rest(tmp_path: Path) -> None:
    file = tmp_path / "base.yaml"
    file.write_text("seed: 7\nsource: {kind: capture, path: elsewhere}\norgans: [{name: leaf}]\n")
    source = CloudsSource(kind="clouds", path="data/My plant (1).npz")
    bare = spec_around(source, Path("data/My plant (1).npz"), None)
    assert (bare.name, bare.source) == ("My_plant_1_", source)
    filled = spec_around(source, Path("data/x.npz"), file)
    assert (filled.seed, filled.organs[0].name, filled.source) == (7, "leaf", source)


@pytest.mark.parametrize(
    ("path", "name"), [("a/b", "b"), ("..x", "x"), ("/", "scan"), ("ü" * 9, "scan"), ("a" * 99, "a" * 64)]
)
def test_any_path_makes_a_valid_name(path: str, name: str) -> None:
    assert scan_name(Path("/") / path) == name


@pytest.fixture
def results(tmp_path: Path) -> Path:
    folder = tmp_path / "result"
    folder.mkdir()
    io.write_result(folder / "result.npz", small_result())
    modes = [mode for organ in small_result().organs for mode in modes_as_truth(organ)]
    io.write_truth(tmp_path / "truth.npz", modes[:1])
    return folder


def test_a_result_is_like_itself(call: Call, results: Path) -> None:
    rows = json.loads(call("compare", results, results / "result.npz", "--json").stdout)
    assert rows
    assert all(row["truth_hz"] == row["found_hz"] and row["mac"] > 0.999 for row in rows if row["mac"] is not None)


def test_a_result_beside_a_truth_keeps_what_is_unmatched(call: Call, results: Path) -> None:
    rows = json.loads(call("compare", results, results.parent / "truth.npz", "--json").stdout)
    assert {"organ", "mode", "truth_hz", "found_hz", "truth_damping", "found_damping", "mac", "verdict"} <= set(rows[0])
    assert [row["truth_hz"] for row in rows if row["truth_hz"] is not None] == [pytest.approx(2.17)]
    assert sum(row["truth_hz"] is None for row in rows) == 3
    assert "2.170" in call("compare", results, results.parent / "truth.npz").stdout
    assert json.loads(call("compare", results, results.parent, "--json").stdout) == rows  # a folder with a truth alone


def test_what_cannot_be_compared_is_3(call: Call, results: Path, tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no")
    for other in ("nowhere", tmp_path / "text.npz"):
        assert call("compare", results, other).exit_code == 3
