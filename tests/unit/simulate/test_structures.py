"""Every structure has organs with truth; those with modes in closed form have the frequencies of the books."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from nerfmodal.errors import InvalidSpec
from nerfmodal.geometry.frames import inside_box
from nerfmodal.simulate import (
    check_source,
    default_organs,
    frame_times,
    modal_masses,
    plant_of,
    true_modes,
    vertices_at,
)
from nerfmodal.simulate.beams import PLATE_LENGTH, PLATE_WIDTH, plate_frequency, tower_frequency
from nerfmodal.simulate.plates import cantilever_plate
from nerfmodal.simulate.preview import vertex_normals
from nerfmodal.spec import ImposedMode, ScanSpec, SimulationSource

EXAMPLES = Path(__file__).parents[3] / "examples"
ORGANS = {
    "acai": [*(f"leaf_{index}" for index in range(5)), "trunk"],
    "herb": [*(f"leaf_{index}" for index in range(6)), "stem"],
    "tree": [*(f"branch_{index}" for index in range(5)), "trunk"],
    "plate": ["sheet"],
    "tower": ["mast"],
}


def source(structure: str, shape: str = "bending_1", organ: str = "*", **changes) -> SimulationSource:
    mode = ImposedMode(organ=organ, shape=shape, frequency_hz=1.7, amplitude_m=0.02)
    return SimulationSource(
        kind="simulation", structure=structure, frames=4, frame_rate_hz=30, motion=(mode,), **changes
    )


def usual(structure: str) -> str:
    return "plate_1" if structure == "plate" else "bending_1"


@pytest.mark.parametrize("structure", ORGANS)
def test_a_structure_has_its_organs_and_coordinates_on_them(structure):
    plant = plant_of(source(structure))
    mesh = plant.mesh
    assert [organ.name for organ in plant.organs] == ORGANS[structure]
    assert plant.along.min() == 0
    assert plant.along.max() == pytest.approx(1.0)
    assert mesh.colors.min() >= 0
    assert mesh.colors.max() <= 1
    assert mesh.vertices[:, 2].min() > -0.03
    assert mesh.triangles.max() < len(mesh.vertices)
    assert plant.masses.min() >= 0
    for organ in plant.organs:
        assert plant.masses[plant.belongs(organ.name)].sum() > 0
        ends = np.linalg.norm(np.diff(organ.line, axis=0), axis=1)
        assert ends == pytest.approx(ends.mean(), rel=0.05)


@pytest.mark.parametrize("structure", ["acai", "herb", "plate"])
def test_sheets_face_up_where_the_light_is_baked(structure):
    plant = plant_of(source(structure))
    mesh = plant.mesh
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    for organ in plant.organs:
        if organ.kind in {"leaf", "plate"}:
            middle = plant.belongs(organ.name) & (plant.along > 0.4) & (plant.along < 0.7)
            assert normals[middle, 2].mean() > 0.4, organ.name


@pytest.mark.parametrize("structure", ORGANS)
def test_what_grows_from_something_stands_on_it(structure):
    plant = plant_of(source(structure))
    for organ in plant.organs:
        if organ.parent is not None:
            parent = plant.organ(organ.parent)
            place = parent.line[round(organ.at * (len(parent.line) - 1))]
            assert np.linalg.norm(place - organ.line[0]) < 0.03


@pytest.mark.parametrize("structure", ORGANS)
@pytest.mark.parametrize("kinematics", ["linear", "rotation"])
def test_every_organ_moves_and_its_foot_stays(structure, kinematics):
    if structure == "plate" and kinematics == "rotation":
        pytest.skip("a plate is no slender member")
    spec = source(structure, usual(structure), kinematics=kinematics)
    check_source(spec)
    plant = plant_of(spec)
    moved = np.linalg.norm(vertices_at(plant, spec, 0.0) - plant.mesh.vertices, axis=1)
    for organ in plant.organs:
        own = plant.belongs(organ.name)
        assert moved[own].max() == pytest.approx(0.02, rel=0.03)
        assert moved[own & (plant.along == 0)].max() < 1e-9
    assert len(true_modes(spec, frame_times(spec))) == len(plant.organs)
    if "stand" in plant.mesh.organs:
        assert not moved[plant.belongs("stand")].any()


@pytest.mark.parametrize("structure", ORGANS)
def test_the_coordinates_of_a_place_on_an_organ_are_found(structure):
    plant = plant_of(source(structure))
    for organ in plant.organs:
        own = plant.belongs(organ.name)
        if organ.kind in {"leaf", "plate"}:
            s, y = organ.locate(plant.mesh.vertices[own])
            assert np.quantile(np.abs(s - plant.along[own]), 0.95) < 0.01
            assert np.quantile(np.abs(y - plant.across[own]), 0.95) < 0.003


@pytest.mark.parametrize("structure", ["herb", "tree", "plate", "tower"])
def test_regions_hold_most_of_their_organ_in_motion(structure):
    spec = source(structure, usual(structure))
    plant = plant_of(spec)
    moved = vertices_at(plant, spec, 0.0)
    for organ, region in zip(plant.organs, default_organs(spec), strict=True):
        outer = plant.belongs(organ.name) & (plant.along > 0.4)
        points = {"stem": organ.line[5:40], "branch": organ.line[40:95]}.get(organ.kind, moved[outer])
        assert inside_box(region.region, points).mean() > 0.97, organ.name


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_tower_has_the_modal_mass_of_a_uniform_beam(order):
    spec = source("tower", f"bending_{order}")
    whole = plant_of(spec).masses.sum()
    assert modal_masses(spec)[0] == pytest.approx(whole / 4, rel=5e-3)


def test_a_towers_frequencies_have_the_ratios_of_a_clamped_beam():
    ratios = [tower_frequency(order) / tower_frequency(1) for order in (2, 3)]
    assert ratios == pytest.approx([6.2669, 17.5475], rel=1e-4)


@pytest.mark.parametrize(
    ("aspect", "eigenvalues"),
    [(1.0, [3.471, 8.507, 21.28, 27.20, 30.96]), (0.5, [3.440, 14.80, 21.44, 48.19, 60.14])],
)
def test_a_plates_frequencies_are_those_of_the_books(aspect, eigenvalues):
    """Leissa's tables as later refined by converged Ritz solutions (Liew, Hung and Lim, 1993), nu = 0.3."""
    assert cantilever_plate(aspect).eigenvalues[:5] == pytest.approx(eigenvalues, rel=1e-3)


def test_a_narrow_plate_is_a_beam():
    assert cantilever_plate(0.02, poisson=0.0).eigenvalues[:3] == pytest.approx([3.5160, 22.0345, 61.6972], rel=1e-4)


def test_plate_shapes_are_orthogonal_and_clamped():
    plate = cantilever_plate(PLATE_WIDTH / PLATE_LENGTH)
    s, y = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, 161), np.linspace(-1, 1, 161), indexing="ij"))
    edge = np.isin(s, (0.0, 1.0)) * 0.5 + ~np.isin(s, (0.0, 1.0))
    edge = edge * (np.isin(y, (-1.0, 1.0)) * 0.5 + ~np.isin(y, (-1.0, 1.0)))
    shapes = np.stack([plate.shape(s, y, order) for order in (1, 2, 3, 4)])
    overlap = (shapes * edge) @ shapes.T
    likeness = overlap / np.sqrt(np.outer(np.diag(overlap), np.diag(overlap)))
    assert likeness == pytest.approx(np.eye(4), abs=2e-3)
    assert np.abs(shapes).max(axis=1) == pytest.approx(1.0, abs=1e-3)
    assert np.abs(shapes[:, s == 0]).max() < 1e-12
    near = plate.shape(np.full(5, 1e-4), np.linspace(-1, 1, 5), 1)
    assert np.abs(near).max() < 1e-6  # no slope at the clamp either


def test_the_second_mode_of_a_plate_twists_it():
    plate = cantilever_plate(PLATE_WIDTH / PLATE_LENGTH)
    tip = plate.shape(np.ones(3), np.array([-1.0, 0.0, 1.0]), 2)
    assert tip[0] == pytest.approx(-tip[2])
    assert tip[1] == pytest.approx(0.0, abs=1e-9)


def test_a_plate_does_not_turn_and_a_tower_does_not_twist():
    with pytest.raises(InvalidSpec, match="no slender member") as refusal:
        check_source(source("plate", "plate_1", kinematics="rotation"))
    assert refusal.value.where == "/source/kinematics"
    with pytest.raises(InvalidSpec, match="no shape of sheet"):
        check_source(source("plate", "bending_1"))
    with pytest.raises(InvalidSpec, match="is round"):
        check_source(source("tower", "torsion_1"))


@pytest.mark.parametrize("name", ["herb", "tree", "plate", "tower"])
def test_an_example_of_every_structure_can_be_filmed(name):
    spec = ScanSpec.model_validate(yaml.safe_load((EXAMPLES / f"{name}.yaml").read_text()))
    assert isinstance(spec.source, SimulationSource)
    assert spec.source.structure == name
    check_source(spec.source)


@pytest.mark.parametrize(("name", "law"), [("plate", plate_frequency), ("tower", tower_frequency)])
def test_examples_of_beams_and_plates_move_at_their_own_frequencies(name, law):
    spec = ScanSpec.model_validate(yaml.safe_load((EXAMPLES / f"{name}.yaml").read_text()))
    assert isinstance(spec.source, SimulationSource)
    for mode in spec.source.motion:
        assert mode.frequency_hz == pytest.approx(law(int(mode.shape[-1])), abs=0.005)
