"""PLY files from elsewhere, in any pose and unit and at uneven times, give the modes without a word more."""

import json
from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io, pipeline
from nerfmodal.errors import InvalidClouds
from nerfmodal.identify.comparison import compare
from nerfmodal.spec import CloudsSource, ScanSpec
from nerfmodal.types import PointCloud, ScanResult, TrueMode

from tests.fixtures.moving_clouds import Flaws, Mode, Scene, Trunk, leaf_clouds, trunk_clouds

INCHES = 1 / 0.0254


def write(folder: Path, clouds: list[PointCloud], unit: str, per_metre: float) -> Path:
    for index, cloud in enumerate(clouds):
        points = per_metre * cloud.points
        io.write_cloud(folder / f"scan{index}.ply", PointCloud(points=points, colors=cloud.colors, time=0.0))
    times = [cloud.time for cloud in clouds]
    (folder / "clouds.json").write_text(json.dumps({"frame_rate_hz": 30, "unit": unit, "times_s": times}))
    return folder


def identified(folder: Path) -> ScanResult:
    spec = ScanSpec(source=CloudsSource(kind="clouds", path=str(folder)))
    return pipeline.identify(spec, list(pipeline.read_clouds(spec)), report=lambda _: None)


def worst(result: ScanResult, truth: list[TrueMode]) -> tuple[float, float, float]:
    """Largest errors of frequency (Hz) and damping, lowest MAC, of all true modes."""
    (organ,) = result.organs
    named = [
        TrueMode(**{name: getattr(mode, name) for name in mode.__slots__} | {"organ": organ.organ}) for mode in truth
    ]
    rows = [row for row in compare(result, named) if row.truth_hz is not None]
    assert all(row.found_hz is not None for row in rows)
    return (
        max(abs((row.found_hz or 0) - (row.truth_hz or 0)) for row in rows),
        max(abs((row.found_damping or 0) - (row.truth_damping or 0)) for row in rows),
        min(row.mac or 0 for row in rows),
    )


def test_a_steep_turned_leaf_in_inches_at_uneven_times_with_lost_frames(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.6, 1.4, 75) / 30.0)
    modes = (Mode(shape="bending_1", frequency=2.17, amplitude=0.03), Mode(shape="bending_2", frequency=4.83))
    pose = {"yaw": 130.0, "pitch": -68.0, "roll": 150.0, "translation": (3.0, -2.0, 5.0)}
    scene = Scene(modes=modes, times=np.delete(times, [20, 21, 50]), points=1500, flaws=Flaws(bias=0.001), **pose)
    clouds, truth = leaf_clouds(scene, 0)
    empty = np.zeros((0, 3))
    clouds[7] = PointCloud(points=empty, colors=empty, time=clouds[7].time)
    result = identified(write(tmp_path, clouds, "in", INCHES))
    assert result.organs[0].surface == "polynomial"
    frequency, damping, mac = worst(result, truth)
    assert frequency < 0.02
    assert damping < 0.005
    assert mac > 0.995


def test_a_trunk_seen_from_a_quarter_and_bending_askew(tmp_path: Path) -> None:
    modes = (Mode(shape="bending_1", frequency=1.57, amplitude=0.03),)
    trunk = Trunk(
        modes=modes,
        times=np.arange(60) / 30.0,
        points=1500,
        bending=137.0,
        seen_degrees=90.0,
        flaws=Flaws(bias=0.0005, outliers=0.03),
    )
    clouds, truth = trunk_clouds(trunk, 0)
    result = identified(write(tmp_path, clouds, "mm", 1000.0))
    assert result.organs[0].surface == "cylinder"
    frequency, damping, mac = worst(result, truth)
    assert frequency < 0.02
    assert damping < 0.01
    assert mac > 0.99


def test_fewer_than_16_clouds_and_empty_ones_are_refused_with_the_remedy(tmp_path: Path) -> None:
    empty = np.zeros((0, 3))
    clouds = [PointCloud(points=empty, colors=empty, time=index / 30) for index in range(16)]
    spec = ScanSpec(source=CloudsSource(kind="clouds", path=str(write(tmp_path, clouds, "m", 1.0))))
    with pytest.raises(InvalidClouds, match="all 16 clouds are empty"):
        pipeline.read_all(pipeline.open_clouds(spec), report=lambda _: None)
    (tmp_path / "scan15.ply").unlink()
    (tmp_path / "clouds.json").write_text('{"frame_rate_hz": 30}')
    with pytest.raises(InvalidClouds, match="15 clouds") as caught:
        pipeline.open_clouds(spec)
    assert caught.value.where == str(tmp_path)
    assert caught.value.hint
