"""The zarr store holds the displacement that the factors say, at any size, without ever holding all of it."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr
from nerfmodal.export import write_displacement
from nerfmodal.export.arrays import SLAB, sensors_within, slabs
from nerfmodal.types import DisplacementMatrix, ModalModel, SensorGrid
from zarr.storage import ZipStore

from tests.fixtures.scans import small_result

RESULT = small_result()


def opened(path: Path) -> zarr.Group:
    return zarr.open_group(ZipStore(path, mode="r"), mode="r")


def test_store_holds_every_organ_with_its_units(tmp_path: Path):
    root = opened(write_displacement(RESULT, tmp_path / "displacement.zarr.zip"))
    for organ in RESULT.organs:
        group, values = root[organ.organ], organ.displacement.values
        np.testing.assert_allclose(group["displacement"][:], values, atol=1e-8, equal_nan=True)
        assert np.isnan(group["displacement"][40]).all()
        assert group["displacement"].metadata.dimension_names == ("frame", "sensor", "axis")
        assert group["displacement"].attrs["unit"] == "m"
        np.testing.assert_array_equal(group["mode_shapes"][:], organ.model.mode_shapes)
        np.testing.assert_array_equal(group["positions"][:], organ.displacement.sensors.positions)
        factors = group["coefficients"][:] @ group["basis"][:].T
        np.testing.assert_allclose(factors.reshape(values.shape), values, atol=1e-15, equal_nan=True)
    assert root.attrs["frame_rate_hz"] == RESULT.frame_rate


def wide(frames: int, sensors: int, axes: int) -> DisplacementMatrix:
    rng = np.random.default_rng(1)
    return DisplacementMatrix(
        coefficients=rng.normal(size=(frames, 3)),
        basis=rng.normal(size=(sensors * axes, 3)),
        directions=np.eye(3)[:axes],
        times=np.arange(frames) / 30,
        frame_rate=30.0,
        sensors=SensorGrid(organ="wide", positions=rng.normal(size=(sensors, 3))),
        valid=np.ones(frames, dtype=bool),
    )


@pytest.mark.parametrize(("frames", "sensors", "axes"), [(300, 9000, 1), (257, 50, 2), (1, 1, 3)])
def test_pieces_tile_the_whole(frames: int, sensors: int, axes: int):
    displacement = wide(frames, sensors, axes)
    whole = np.full((frames, sensors, axes), np.nan)
    for frame, sensor, values in slabs(displacement, np.arange(sensors)):
        part = whole[frame : frame + len(values), sensor : sensor + values.shape[1]]
        assert np.isnan(part).all()
        part[:] = values
    np.testing.assert_allclose(whole, displacement.values, atol=1e-12)


def test_beyond_the_limit_sensors_are_thinned_evenly_and_named(tmp_path: Path):
    displacement = wide(40, 1000, 2)
    model = replace(no_modes(displacement), coordinates=np.zeros((40, 0)))
    organ = replace(RESULT.organs[1], organ="wide", displacement=displacement, model=model)
    path = write_displacement(replace(RESULT, organs=(organ,)), tmp_path / "wide.zarr.zip", most_bytes=40 * 2 * 4 * 100)
    group = opened(path)["wide"]
    chosen = group["displacement_sensors"][:]
    assert (len(chosen), chosen[0], chosen[-1]) == (100, 0, 999)
    np.testing.assert_allclose(group["displacement"][:], displacement.values[:, chosen], atol=1e-6)
    assert group["basis"].shape == (2000, 3)
    np.testing.assert_array_equal(sensors_within(displacement, 1 << 30), np.arange(1000))


def no_modes(displacement: DisplacementMatrix) -> ModalModel:
    nothing = np.zeros(0)
    return ModalModel(
        frequencies=nothing,
        frequency_stds=nothing,
        damping_ratios=nothing,
        damping_stds=nothing,
        mode_shapes=np.zeros((len(displacement.sensors.positions), len(displacement.directions), 0)),
        coordinates=np.zeros((len(displacement.times), 0)),
        quality=(),
    )


def test_memory_is_that_of_a_piece_not_of_the_whole(tmp_path: Path):
    displacement = wide(600, 20_000, 1)
    organ = replace(RESULT.organs[1], organ="wide", displacement=displacement, model=no_modes(displacement))
    result = replace(RESULT, organs=(organ,))
    tracemalloc.start()
    write_displacement(result, tmp_path / "wide.zarr.zip")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 8 * 600 * 20_000 > 90e6
    assert peak < 5 * 8 * SLAB[0] * SLAB[1]
