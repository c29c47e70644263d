"""Members that turn keep their length, agree with the linear ones while small, and make even harmonics when not."""

import numpy as np
import pytest
from nerfmodal.simulate import acai, true_modes, vertices_at
from nerfmodal.simulate.kinematics import bent, shifted, turned
from nerfmodal.spec import Harmonic, ImposedMode, SimulationSource

TRUNK = ImposedMode(organ="trunk", shape="bending_1", frequency_hz=1.07, damping_ratio=0.01, amplitude_m=0.04)
BEND = ImposedMode(organ="leaf_*", shape="bending_1", frequency_hz=2.17, damping_ratio=0.01, amplitude_m=0.05)
TWIST = BEND.model_copy(update={"shape": "torsion_1", "frequency_hz": 9.61, "amplitude_m": 0.03, "phase_deg": 60})


def source(*motion: ImposedMode, **changes) -> SimulationSource:
    return SimulationSource(kind="simulation", frames=8, frame_rate_hz=40, motion=motion).model_copy(update=changes)


def lengths(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(points, axis=0), axis=1)


@pytest.mark.parametrize("amplitude", [0.05, 0.3])
def test_a_turned_member_keeps_the_length_of_every_piece(amplitude):
    plant = acai()
    for name, mode in (("leaf_1", BEND), ("trunk", TRUNK)):
        organ = plant.organ(name)
        moved = bent(organ, amplitude * turned(plant, organ, mode).turns)
        assert lengths(moved.line) == pytest.approx(lengths(organ.line), rel=1e-12)
        assert not np.allclose(moved.line, organ.line)


def test_the_papers_offset_stretches_a_leaf():
    plant = acai()
    leaf = plant.organ("leaf_0")
    stretched = leaf.line + 0.3 * shifted(plant, leaf, BEND).shifts
    assert abs(lengths(stretched).sum() / lengths(leaf.line).sum() - 1) > 0.01


def test_sections_stay_plane_and_stiff():
    spec = source(BEND, TWIST, kinematics="rotation")
    plant = acai()
    leaf = plant.belongs("leaf_2")
    before, after = plant.mesh.vertices[leaf], vertices_at(plant, spec, 0.02)[leaf]
    ring = np.flatnonzero(np.abs(plant.along[leaf] - 0.5) < 1e-9)
    assert len(ring) >= 6
    apart = [np.linalg.norm(points[ring, None] - points[None, ring], axis=2) for points in (before, after)]
    assert apart[1] == pytest.approx(apart[0], abs=1e-12)


@pytest.mark.parametrize("coupled", [False, True])
def test_a_small_rotation_is_its_truths_shapes_times_their_coordinates(coupled):
    small = [mode.model_copy(update={"amplitude_m": 1e-5}) for mode in (BEND, TWIST, TRUNK)]
    spec, plant = source(*small, kinematics="rotation", coupled=coupled), acai()
    expected = np.zeros_like(plant.mesh.vertices)
    for mode in true_modes(spec, np.array([0.03])):
        expected[plant.belongs(mode.organ)] += mode.shape * mode.coordinates[0]
    moved = vertices_at(plant, spec, 0.03) - plant.mesh.vertices
    assert np.abs(moved).max() > 3e-6
    assert moved == pytest.approx(expected, abs=2e-9)


def test_a_straight_member_bends_alike_in_both_kinematics():
    plant = acai()
    trunk = plant.organ("trunk")
    linear, rotation = shifted(plant, trunk, TRUNK).shifts, turned(plant, trunk, TRUNK).shifts
    assert rotation[:, 0] == pytest.approx(linear[:, 0], abs=0.03)
    assert np.abs(rotation[:, 1:]).max() < 0.06


def tip_harmonics(amplitude: float, kinematics: str) -> np.ndarray:
    """Amplitudes at the first and the second harmonic of a leaf's tip, in steady motion over whole periods."""
    mode = BEND.model_copy(update={"frequency_hz": 2.0, "amplitude_m": amplitude})
    spec, plant = source(mode, kinematics=kinematics, excitation=Harmonic(kind="harmonic")), acai()
    tip = np.flatnonzero(plant.belongs("leaf_0") & (plant.along == 1.0))[0]
    track = np.stack([vertices_at(plant, spec, k / 32)[tip] for k in range(16)])
    return np.linalg.norm(np.fft.rfft(track, axis=0), axis=1)[1:3] / 8


def test_a_second_harmonic_grows_with_the_square_of_the_swing():
    first, second = np.transpose([tip_harmonics(amplitude, "rotation") for amplitude in (0.02, 0.04, 0.08)])
    assert first[1:] / first[:-1] == pytest.approx(2.0, rel=0.02)
    assert second[1:] / second[:-1] == pytest.approx(4.0, rel=0.02)
    assert second[2] > 0.01 * first[2]


def test_linear_motion_has_no_harmonics():
    first, second = tip_harmonics(0.08, "linear")
    assert second < 1e-10 * first


def test_uncoupled_leaves_stand_still_while_the_trunk_sways():
    plant = acai()
    moved = vertices_at(plant, source(TRUNK), 0.0)
    assert np.array_equal(moved[plant.belongs("leaf_3")], plant.mesh.vertices[plant.belongs("leaf_3")])


def test_coupled_leaves_ride_on_the_top_of_the_trunk():
    plant, spec = acai(), source(TRUNK, coupled=True, kinematics="rotation")
    moved = vertices_at(plant, spec, 0.0)
    for leaf in ("leaf_0", "leaf_3"):
        chosen = plant.belongs(leaf)
        before, after = plant.mesh.vertices[chosen], moved[chosen]
        far = np.linalg.norm(before - before[0], axis=1)
        assert np.linalg.norm(after - after[0], axis=1) == pytest.approx(far, abs=1e-12)
        assert (after - before)[:, 0].mean() == pytest.approx(0.04, abs=0.01)


def test_the_truth_of_coupled_leaves_has_the_trunks_mode():
    modes = true_modes(source(BEND, TRUNK, coupled=True), np.zeros(1))
    names = [(mode.organ, mode.name, mode.frequency) for mode in modes if mode.organ in {"leaf_0", "trunk"}]
    assert names == [("leaf_0", "bending_1", 2.17), ("leaf_0", "trunk bending_1", 1.07), ("trunk", "bending_1", 1.07)]
    assert all(np.linalg.norm(mode.shape, axis=1).max() == pytest.approx(1.0) for mode in modes)


def test_linear_riders_shift_and_turn_with_the_trunks_top():
    plant = acai()
    trunk = plant.organ("trunk")
    ridden = next(mode for mode in true_modes(source(TRUNK, coupled=True), np.zeros(1)) if mode.organ == "leaf_0")
    arms = ridden.points - trunk.line[-1]
    turn = shifted(plant, trunk, TRUNK).turns[-1]
    expected = 0.04 * (np.array([1.0, 0.0, 0.0]) + np.cross(turn, arms))
    assert ridden.shape * ridden.coordinates[0] == pytest.approx(expected, abs=1e-12)
    assert np.linalg.norm(turn) == pytest.approx(1.3765 / trunk.length, rel=2e-3)
