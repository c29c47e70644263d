"""Each flaw of a camera obeys its law, is the same for the same seed, and is absent unless asked for."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.simulate import plant_of, preview, render_frame, vertices_at
from nerfmodal.simulate.light import to_linear, to_srgb
from nerfmodal.simulate.sensor import exposures, sensed, told_rig
from nerfmodal.simulate.stage import subpixels
from nerfmodal.spec import Harmonic, ImposedMode, RigSpec, SensorSpec, SimulationSource

RIG = RigSpec(cameras=3, radius_m=3.2, target_m=(0.0, 0.0, 1.4), field_of_view_deg=51, width_px=48, height_px=60)
SWAY = ImposedMode(organ="mast", shape="bending_1", frequency_hz=2.0, amplitude_m=0.3)


def source(**changes) -> SimulationSource:
    return SimulationSource(
        kind="simulation",
        structure="tower",
        frames=4,
        frame_rate_hz=30,
        motion=(SWAY,),
        excitation=Harmonic(kind="harmonic"),
        rig=RIG,
        renderer="preview",
        samples=2,
    ).model_copy(update=changes)


def images(sensor: SensorSpec, frame: int = 1) -> np.ndarray:
    return render_frame(source(sensor=sensor), frame, 0, report=lambda _a, _b: None).images


def seen_at(time: float, samples: int = 2, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """What perfect cameras see at any moment, at some place in their pixels."""
    spec = source()
    plant = plant_of(spec)
    vertices = vertices_at(plant, spec, time)
    with preview.open_studio(plant.mesh, vertices, 0) as studio:
        cameras = semi_spherical_rig(RIG).cameras
        moved = [replace(one, center_x=one.center_x - shift[0], center_y=one.center_y - shift[1]) for one in cameras]
        return np.stack([studio.shoot(camera, samples) for camera in moved])


def test_a_perfect_sensor_changes_no_pixel():
    assert np.array_equal(images(SensorSpec()), seen_at(1 / 30))
    picture = np.arange(256, dtype=np.uint8).repeat(3).reshape(1, 256, 3)
    assert np.array_equal(to_srgb(to_linear(picture)), picture)


@pytest.mark.parametrize("level", [0.05, 0.4])
def test_noise_is_that_of_a_photon_transfer_curve(level):
    sensor = SensorSpec(full_well_e=2000, read_noise_e=12)
    values = sensed(np.full((300, 300, 3), level), sensor, view=0, frame=0) * 2000
    assert values.mean() == pytest.approx(level * 2000, rel=0.01)
    assert values.var() == pytest.approx(level * 2000 + 12**2, rel=0.03)


def test_noise_differs_from_frame_to_frame_and_repeats_itself():
    sensor, light = SensorSpec(full_well_e=2000), np.full((8, 8, 3), 0.4)
    first = sensed(light, sensor, 0, 0)
    assert np.array_equal(first, sensed(light, sensor, 0, 0))
    for view, frame in ((0, 1), (1, 0)):
        assert abs(np.corrcoef(first.ravel(), sensed(light, sensor, view, frame).ravel())[0, 1]) < 0.3


def test_a_full_well_holds_no_more():
    sensor = SensorSpec(full_well_e=500, read_noise_e=30)
    values = sensed(np.full((40, 40, 3), 3.0), sensor, 0, 0)
    assert values.max() == 1.0
    assert np.all(values == 1.0)


def test_noisy_pictures_are_the_clean_ones_on_average():
    clean, noisy = to_linear(images(SensorSpec())), to_linear(images(SensorSpec(full_well_e=800)))
    difference = noisy - clean
    assert 0.005 < difference.std() < 0.05
    assert abs(difference[clean < 0.8].mean()) < 1e-3


def test_exposures_of_cameras_spread_by_the_stops_that_were_asked_for():
    sensor, light = SensorSpec(exposure_spread_ev=0.3), np.full((1, 1, 3), 0.2)
    stops = np.log2([sensed(light, sensor, view, 0)[0, 0] / 0.2 for view in range(600)])
    assert stops.std(axis=0) == pytest.approx(0.3, rel=0.1)
    assert stops.mean() == pytest.approx(0.0, abs=0.04)
    assert np.ptp(stops, axis=1).max() < 1e-9
    assert np.array_equal(sensed(light, sensor, 4, 0), sensed(light, sensor, 4, 17))


def test_white_balance_leaves_green_alone():
    sensor, light = SensorSpec(white_balance_spread=0.1), np.full((1, 1, 3), 0.2)
    gains = np.log([sensed(light, sensor, view, 0)[0, 0] / 0.2 for view in range(600)])
    assert gains[:, 1] == pytest.approx(0.0, abs=1e-12)
    assert gains[:, [0, 2]].std(axis=0) == pytest.approx(0.1, rel=0.1)


def test_an_open_shutter_shows_the_mean_of_its_instants():
    blurred = to_linear(images(SensorSpec(shutter_s=0.06, instants=4)))
    moments = 1 / 30 + 0.06 * ((np.arange(4) + 0.5) / 4 - 0.5)
    places = [tuple(map(float, shift)) for shift in subpixels(4)]
    seen = [to_linear(seen_at(float(time), 1, shift)) for time, shift in zip(moments, places, strict=True)]
    mean = np.mean(seen, axis=0)
    assert np.abs(blurred - mean).max() < 0.02
    assert np.abs(to_linear(seen_at(1 / 30)) - mean).max() > 0.2


def test_rows_of_a_rolling_shutter_are_those_of_their_instants():
    rolled = images(SensorSpec(rolling_shutter_s=0.2, instants=4))
    rows = RIG.height_px
    for band in range(4):
        first, end = band * rows // 4, (band + 1) * rows // 4
        time = 1 / 30 + 0.2 * ((band + 0.5) / 4 - 0.5)
        difference = to_linear(rolled)[:, first:end] - to_linear(seen_at(time))[:, first:end]
        assert np.abs(difference).max() < 0.01
    assert not np.array_equal(rolled, seen_at(1 / 30))


def test_a_rolling_shutters_middle_row_is_on_time():
    parts = exposures(SensorSpec(rolling_shutter_s=0.02, instants=5), 0, 0, rows=100)
    assert [(part.first, part.end) for part in parts] == [(0, 20), (20, 40), (40, 60), (60, 80), (80, 100)]
    assert [part.offset for part in parts] == pytest.approx([-0.008, -0.004, 0.0, 0.004, 0.008])


def test_both_shutters_together_cover_every_row_wholly():
    parts = exposures(SensorSpec(rolling_shutter_s=0.02, shutter_s=0.01, instants=3), 0, 0, rows=31)
    covered = np.zeros(31)
    for part in parts:
        covered[part.first : part.end] += part.share
    assert covered == pytest.approx(np.ones(31))


def test_jitter_moves_the_instant_of_every_picture():
    sensor = SensorSpec(jitter_s=0.004)
    late = np.array([[exposures(sensor, view, frame, 10)[0].offset for frame in range(40)] for view in range(20)])
    assert late.std() == pytest.approx(0.004, rel=0.1)
    assert len(np.unique(late)) == late.size
    found = images(sensor)
    for view in range(3):
        alone = seen_at(1 / 30 + float(exposures(sensor, view, 1, RIG.height_px)[0].offset))
        assert np.array_equal(found[view], alone[view])


def test_a_calibration_errs_by_what_was_asked_for_and_pictures_do_not():
    sensor = SensorSpec(position_error_m=0.01, rotation_error_deg=0.2, focal_error=0.01)
    true = semi_spherical_rig(RIG.model_copy(update={"cameras": 200}))
    told = told_rig(true, sensor)
    poses = [np.stack([camera.camera_to_world for camera in rig.cameras]) for rig in (true, told)]
    assert (poses[1] - poses[0])[:, :3, 3].std() == pytest.approx(0.01, rel=0.1)
    turns = np.swapaxes(poses[0], 1, 2)[:, :3, :3] @ poses[1][:, :3, :3]
    angles = np.degrees(np.arccos((np.trace(turns, axis1=1, axis2=2) - 1) / 2))
    assert np.sqrt(np.mean(angles**2)) == pytest.approx(0.2 * np.sqrt(3), rel=0.1)
    focal = [camera.focal_x / before.focal_x - 1 for camera, before in zip(told.cameras, true.cameras, strict=True)]
    assert np.std(focal) == pytest.approx(0.01, rel=0.2)
    assert np.array_equal(images(sensor), images(SensorSpec()))


def test_a_perfect_calibration_tells_the_true_rig():
    true = semi_spherical_rig(RIG)
    for camera, told in zip(true.cameras, told_rig(true, SensorSpec()).cameras, strict=True):
        assert camera.camera_to_world == pytest.approx(told.camera_to_world, abs=1e-15)
        assert camera.focal_x == told.focal_x


def test_what_stands_still_is_as_smooth_under_an_open_shutter():
    still = SimulationSource.model_validate({**source(samples=16).model_dump(), "motion": []})
    open_ = still.model_copy(update={"sensor": SensorSpec(shutter_s=0.01, instants=16)})
    fine, blurred, rough = (
        to_linear(render_frame(one, 0, 0, report=lambda _a, _b: None).images)
        for one in (still, open_, still.model_copy(update={"samples": 1}))
    )
    assert np.abs(blurred - fine).mean() < 0.2 * np.abs(rough - fine).mean()
