"""The palm has the paper's size, its organs know their points, and their regions keep them apart."""

from itertools import pairwise

import numpy as np
import pytest
from nerfmodal.errors import InvalidSpec
from nerfmodal.geometry.frames import inside_box
from nerfmodal.simulate import acai, default_organs, default_region, palm
from nerfmodal.simulate.leaves import LeafForm, LeafSurface
from nerfmodal.simulate.palm import LEAF_ROOM_FROM
from nerfmodal.simulate.plants import MOTION_ROOM
from nerfmodal.simulate.shapes import cantilever_shape
from nerfmodal.spec import PalmSpec, SimulationSource

SOURCE = SimulationSource(kind="simulation", frames=1, frame_rate_hz=30, motion=())
LEAVES = tuple(f"leaf_{index}" for index in range(5))


def test_the_palm_is_as_high_and_wide_as_asked():
    sizes = np.ptp(acai().mesh.vertices, axis=0)
    assert sizes[2] == pytest.approx(2.59, abs=1e-6)
    assert sizes[:2].max() == pytest.approx(1.61, abs=1e-5)


def test_another_size_is_met_as_well():
    sizes = np.ptp(acai(PalmSpec(height_m=1.8, width_m=1.2, leaf_length_m=0.7)).mesh.vertices, axis=0)
    assert sizes[2] == pytest.approx(1.8, abs=1e-6)
    assert sizes[:2].max() == pytest.approx(1.2, abs=1e-5)


def test_leaves_that_cannot_reach_the_width_are_refused():
    with pytest.raises(InvalidSpec, match="m wide, not 3 m") as refusal:
        acai(PalmSpec(width_m=3.0))
    assert refusal.value.where == "/source/palm/width_m"


def test_a_palm_without_room_for_a_stem_is_refused():
    with pytest.raises(InvalidSpec, match="no stem") as refusal:
        acai(PalmSpec(height_m=0.4))
    assert refusal.value.where == "/source/palm/height_m"


def test_the_rachis_has_its_length():
    surface = LeafSurface(form=LeafForm(), base=np.zeros(3), yaw=0.3)
    line = surface.rachis(np.linspace(0, 1, 4001))
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(0.98, abs=1e-6)


def test_the_normal_stands_on_the_rachis():
    surface = LeafSurface(form=LeafForm(), base=np.zeros(3), yaw=1.1)
    s, step = np.linspace(0, 0.99, 9), 1e-6
    along = (surface.rachis(s + step) - surface.rachis(s)) / step
    assert np.abs((along * surface.normals(s)).sum(axis=1)).max() < 1e-5


def test_organs_are_five_leaves_at_72_degrees_and_a_trunk():
    plant = acai()
    assert plant.mesh.organs == (*LEAVES, "trunk")
    tips = [plant.mesh.vertices[plant.belongs(leaf) & (plant.along > 0.99)].mean(axis=0) for leaf in LEAVES]
    yaws = np.degrees([np.arctan2(tip[1], tip[0]) for tip in tips])
    assert np.diff(np.append(yaws, yaws[0])) % 360 == pytest.approx(72.0, abs=1.0)


def test_organ_coordinates_are_shares_of_length_and_metres_across():
    plant = acai()
    assert plant.along.min() == 0.0
    assert plant.along.max() == 1.0
    leaf = plant.belongs("leaf_0")
    # leaf_0 points along x, so that its lateral coordinate is the world's y up to the blade's thickness
    assert plant.across[leaf] == pytest.approx(plant.mesh.vertices[leaf, 1], abs=1e-9)
    assert 0.15 < np.abs(plant.across[leaf]).max() < 0.2


def test_leaflets_cover_most_of_the_outline_and_leave_gaps():
    plant = acai()
    leaf = plant.belongs("leaf_0")
    s, y = plant.along * 0.98, plant.across
    corners = plant.mesh.triangles[leaf[plant.mesh.triangles[:, 0]]]
    a, b, c = (np.stack([s, y], axis=1)[corners[:, k]] for k in range(3))
    covered = 0.5 * np.abs(np.cross(b - a, c - a)).sum()
    edges = np.linspace(0.15, 0.98, 15)
    reach = [np.abs(y[leaf & (s >= low) & (s < high)]).max() for low, high in pairwise(edges)]
    outline = 2 * np.sum(np.array(reach) * np.diff(edges))
    assert 0.55 < covered / outline < 0.8


def test_every_triangle_belongs_to_one_organ():
    mesh = acai().mesh
    assert np.ptp(mesh.organ[mesh.triangles], axis=1).max() == 0


def test_a_region_holds_its_organ_in_motion_and_hardly_a_point_of_another():
    plant = acai()
    for organ in plant.organs:
        own = plant.belongs(organ.name)
        if organ.kind == "leaf":
            own &= np.hypot(*plant.mesh.vertices[:, :2].T) > LEAF_ROOM_FROM
        else:
            own &= (plant.mesh.vertices[:, 2] > 0.03) & (plant.along < 0.98)
        axis = [0.0, 0.0, MOTION_ROOM] if organ.kind == "leaf" else [MOTION_ROOM, 0.0, 0.0]
        bending = cantilever_shape(plant.along, 1)[:, None] * np.array(axis)
        for swing in (-0.99, 0.0, 0.99):
            inside = inside_box(organ.region, plant.mesh.vertices + swing * bending)
            assert inside[own].mean() > 0.99, organ.name
        others = ~plant.belongs(organ.name)
        assert inside_box(organ.region, plant.mesh.vertices)[others].sum() <= 0.01 * own.sum()


def test_the_plants_region_holds_it_from_just_above_the_ground():
    plant, region = acai(), default_region(SOURCE)
    above = plant.mesh.vertices[plant.mesh.vertices[:, 2] > 0.02]
    assert np.all(above - MOTION_ROOM > np.array(region.min_m) - [0, 0, 1])
    assert np.all(above + MOTION_ROOM < np.array(region.max_m))
    assert region.min_m[2] == 0.02


def test_default_organs_are_polynomial_leaves_and_a_cylinder():
    organs = default_organs(SOURCE)
    assert [(organ.name, organ.surface, organ.degree) for organ in organs] == [
        *((leaf, "polynomial", 5) for leaf in LEAVES),
        ("trunk", "cylinder", 4),
    ]
    assert all(organ.region == acai().regions[organ.name] for organ in organs)


def test_a_plant_is_the_same_for_a_seed_and_another_for_another():
    palm._grown.cache_clear()
    first = acai()
    palm._grown.cache_clear()
    assert np.array_equal(first.mesh.vertices, acai().mesh.vertices)
    assert not np.array_equal(first.mesh.vertices, acai(PalmSpec(seed=1)).mesh.vertices)
