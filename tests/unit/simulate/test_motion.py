"""Imposed motion obeys beam theory and the law of a damped oscillator."""

import numpy as np
import pytest
from nerfmodal.errors import InvalidSpec
from nerfmodal.simulate import acai, frame_times, modal_masses, shape_at, true_modes, vertices_at
from nerfmodal.simulate.excitation import modal_coordinate
from nerfmodal.simulate.shapes import BEAM_ROOTS, cantilever_shape, cantilever_slope, shaft_twist
from nerfmodal.spec import ImposedMode, PalmSpec, SimulationSource, Wind
from scipy.integrate import simpson

DECAY = ImposedMode(
    organ="leaf_*", shape="bending_1", frequency_hz=2.3, damping_ratio=0.03, amplitude_m=0.04, phase_deg=25
)


def source(*motion: ImposedMode) -> SimulationSource:
    return SimulationSource(kind="simulation", frames=8, frame_rate_hz=40, motion=motion)


def test_roots_are_those_of_the_clamped_free_beam():
    assert list(BEAM_ROOTS) == pytest.approx([1.8751, 4.6941, 7.8548], abs=5e-5)
    assert np.cos(BEAM_ROOTS) * np.cosh(BEAM_ROOTS) == pytest.approx(-1.0, abs=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_bending_is_clamped_at_the_base_and_free_at_the_tip(order):
    h = 1e-3

    def phi(*s: float) -> np.ndarray:
        return cantilever_shape(np.array(s), order)

    assert phi(0.0)[0] == pytest.approx(0.0, abs=1e-12)
    assert np.diff(phi(-h, h))[0] / (2 * h) == pytest.approx(0.0, abs=1e-4)
    assert np.diff(phi(1 - h, 1, 1 + h), 2)[0] / h**2 == pytest.approx(0.0, abs=1e-3)
    assert np.diff(phi(1 - 3 * h, 1 - h, 1 + h, 1 + 3 * h), 3)[0] / (2 * h) ** 3 == pytest.approx(0.0, abs=1e-2)


@pytest.mark.parametrize("order", [1, 2])
def test_bending_solves_the_beam_equation(order):
    h, s = 0.02, 0.6
    stencil = cantilever_shape(s + h * np.arange(-2, 3), order)
    fourth = np.diff(stencil, 4)[0] / h**4
    assert fourth == pytest.approx(BEAM_ROOTS[order - 1] ** 4 * stencil[2], rel=5e-3)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_bending_is_largest_at_the_tip(order):
    shape = cantilever_shape(np.linspace(0, 1, 501), order)
    assert shape[-1] == pytest.approx(1.0)
    assert np.abs(shape).max() == pytest.approx(1.0)


def test_the_second_bending_has_its_node_where_tables_have_it():
    s = np.linspace(0.05, 1, 200001)
    node = s[np.argmin(np.abs(cantilever_shape(s, 2)))]
    assert node == pytest.approx(0.7834, abs=1e-3)


def test_bendings_are_orthogonal_and_have_a_quarter_of_the_beams_mass():
    s = np.linspace(0, 1, 20001)
    shapes = np.stack([cantilever_shape(s, order) for order in (1, 2, 3)])
    overlaps = simpson(shapes[:, None] * shapes[None], x=s)
    assert overlaps == pytest.approx(np.eye(3) / 4, abs=1e-6)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_slope_is_the_shapes_derivative(order):
    s, h = np.linspace(0.05, 0.95, 19), 1e-6
    numeric = (cantilever_shape(s + h, order) - cantilever_shape(s - h, order)) / (2 * h)
    assert cantilever_slope(s, order) == pytest.approx(numeric, abs=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_a_shafts_twist_is_clamped_at_the_base_and_free_at_the_tip(order):
    h = 1e-4
    ends = shaft_twist(np.array([0.0, 1 - h, 1.0, 1 + h]), order)
    assert ends[0] == 0.0
    assert abs(ends[2]) == pytest.approx(1.0)
    assert ends[3] - ends[1] == pytest.approx(0.0, abs=1e-12)


def test_torsion_is_odd_across():
    plant, twist = acai(), DECAY.model_copy(update={"shape": "torsion_1"})
    mode = true_modes(source(twist), np.zeros(1))[0]
    leaf = plant.belongs("leaf_0")
    lever = plant.across[leaf] * np.sin(np.pi * plant.along[leaf] / 2)
    assert mode.shape[:, 2] == pytest.approx(lever / np.abs(lever).max())


def test_the_coordinate_solves_the_damped_oscillator():
    h = 1e-4
    t = np.arange(1, 2000) * 1e-3
    q = [modal_coordinate(DECAY, t + shift) for shift in (-h, 0.0, h)]
    w = 2 * np.pi * 2.3
    velocity, acceleration = (q[2] - q[0]) / (2 * h), (q[2] - 2 * q[1] + q[0]) / h**2
    residual = acceleration + 2 * 0.03 * w * velocity + w**2 * q[1]
    assert np.abs(residual).max() < 1e-4 * w**2 * 0.04


def test_one_damped_period_shrinks_by_the_logarithmic_decrement():
    zeta, w = 0.03, 2 * np.pi * 2.3
    period = 2 * np.pi / (w * np.sqrt(1 - zeta**2))
    first, next_ = modal_coordinate(DECAY, np.array([0.1, 0.1 + period]))
    assert np.log(first / next_) == pytest.approx(2 * np.pi * zeta / np.sqrt(1 - zeta**2))


def test_vertices_are_rest_plus_shape_times_coordinate():
    spec = source(DECAY, ImposedMode(organ="leaf_2", shape="torsion_1", frequency_hz=9, amplitude_m=0.01, phase_deg=80))
    plant, time = acai(), 0.21
    moved = vertices_at(plant, spec, time) - plant.mesh.vertices
    expected = np.zeros_like(moved)
    for mode in true_modes(spec, np.array([time])):
        expected[plant.belongs(mode.organ)] += mode.shape * mode.coordinates[0]
    assert moved == pytest.approx(expected, abs=1e-15)
    tip = plant.belongs("leaf_0") & (plant.along == 1.0)
    assert moved[tip, 2] == pytest.approx(modal_coordinate(DECAY, np.array([time]))[0])
    assert not moved[plant.belongs("trunk")].any()


def test_leaves_swing_up_and_down_and_the_trunk_along_x_and_feet_stay():
    trunk = ImposedMode(organ="trunk", shape="bending_1", frequency_hz=1, amplitude_m=0.03)
    plant, modes = acai(), true_modes(source(DECAY, trunk), frame_times(source(DECAY)))
    assert [mode.organ for mode in modes] == list(plant.mesh.organs)
    for mode in modes:
        axis = 0 if mode.organ == "trunk" else 2
        assert np.abs(np.delete(mode.shape, axis, axis=1)).max() == 0.0
        assert np.linalg.norm(mode.shape, axis=1).max() == pytest.approx(1.0)
        fixed = plant.along[plant.belongs(mode.organ)] == 0.0
        assert mode.shape[fixed] == pytest.approx(0.0, abs=1e-12)
        assert mode.coordinates.shape == (8,)


def test_a_direction_is_used_whatever_its_length():
    mode = DECAY.model_copy(update={"direction": (0.0, 3.0, 4.0)})
    shape = true_modes(source(mode), np.zeros(1))[0].shape
    signed_length = np.linalg.norm(shape, axis=1) * np.sign(shape[:, 1])
    np.testing.assert_allclose(shape, np.outer(signed_length, [0.0, 0.6, 0.8]), atol=1e-12)


def test_a_mode_of_no_organ_is_refused_by_its_pointer():
    stray = DECAY.model_copy(update={"organ": "frond_*"})
    with pytest.raises(InvalidSpec, match="frond") as refusal:
        true_modes(source(DECAY, stray), np.zeros(1))
    assert refusal.value.where == "/source/motion/1/organ"
    assert "leaf_0" in str(refusal.value.hint)


@pytest.mark.parametrize("kinematics", ["linear", "rotation"])
def test_the_truths_shape_can_be_asked_anywhere_on_the_surface(kinematics):
    twist = DECAY.model_copy(update={"shape": "torsion_1"})
    spec = source(DECAY, twist).model_copy(update={"kinematics": kinematics})
    modes = [mode for mode in true_modes(spec, np.zeros(1)) if mode.organ == "leaf_2"]
    asked = shape_at(spec, "leaf_2", modes[0].points)
    for mode, shape in zip(modes, asked, strict=True):
        assert shape == pytest.approx(mode.shape, abs=5e-3)
    between = shape_at(spec, "leaf_2", modes[0].points[:2].mean(axis=0, keepdims=True))
    for mode, shape in zip(modes, between, strict=True):
        assert shape[0] == pytest.approx(mode.shape[:2].mean(axis=0), abs=5e-3)


def test_an_organ_may_have_one_shape_in_two_directions():
    aside = DECAY.model_copy(update={"organ": "trunk", "direction": (0.0, 1.0, 0.0)})
    ahead = DECAY.model_copy(update={"organ": "trunk", "direction": (1.0, 0.0, 0.0)})
    spec = source(ahead, aside).model_copy(update={"excitation": Wind(kind="wind")})
    first, second = true_modes(spec, frame_times(spec))
    assert not np.array_equal(first.coordinates, second.coordinates)
    x, y = shape_at(spec, "trunk", first.points[-1:])
    assert x[0] == pytest.approx([1, 0, 0])
    assert y[0] == pytest.approx([0, 1, 0])


def test_modal_masses_are_the_plants_masses_weighed_by_the_shapes():
    spec = source(DECAY)
    masses = modal_masses(spec)
    plant = acai()
    leaf = plant.belongs("leaf_0")
    assert masses.shape == (5,)
    assert masses[0] == pytest.approx(np.sum(plant.masses[leaf] * cantilever_shape(plant.along[leaf], 1) ** 2))
    heavier = spec.model_copy(update={"palm": PalmSpec(leaflet_mass_kg=0.01)})
    assert modal_masses(heavier)[0] > masses[0]
