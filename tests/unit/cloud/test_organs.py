"""Organs found in clouds whose organs are known: how many, of which kind, and whose points they hold."""

from collections.abc import Callable

import numpy as np
import pytest
from nerfmodal.cloud import FoundOrgan, assign, find_organs, specify
from nerfmodal.cloud.branches import branches
from nerfmodal.cloud.ground import without_ground
from nerfmodal.cloud.sheets import roughness, solidity
from nerfmodal.cloud.voxels import stable_cells
from nerfmodal.errors import InvalidClouds
from nerfmodal.spec import OrganSpec
from nerfmodal.types import PointCloud

from tests.fixtures.scenes import Labelled, leaf, palm, pooled, shares, together, trunk

LEAF_AND_TRUNK = (trunk(0), leaf(0, place=(0.12, 0.0, 2.15), yaw=40.0, pitch=20.0))


def found_in(scene: Labelled) -> tuple[FoundOrgan, ...]:
    return find_organs(scene.clouds, np.random.default_rng(0))


def table(scene: Labelled, organs: tuple[FoundOrgan, ...]) -> np.ndarray:
    """Share of each true organ's points (columns) that each found one (rows) holds."""
    points = pooled(scene)
    return np.stack([shares(scene, organ.contains(points)) for organ in organs])


@pytest.mark.parametrize(
    ("scene", "kinds"),
    [
        (lambda: together([leaf(0, yaw=70.0, pitch=-65.0, roll=30.0)]), ["sheet"]),
        (lambda: together([leaf(1, noise=0.02)]), ["sheet"]),
        (lambda: together([trunk(0)]), ["rod"]),
        (lambda: together([trunk(1, seen=90.0, bending=50.0)]), ["rod"]),
    ],
)
def test_one_organ_is_found_as_one(scene: Callable[[], Labelled], kinds: list[str]) -> None:
    drawn = scene()
    organs = found_in(drawn)
    assert [organ.kind for organ in organs] == kinds
    assert table(drawn, organs)[0, 0] > 0.9


def test_a_leaf_on_a_trunk_and_the_trunk_are_two() -> None:
    scene = together(LEAF_AND_TRUNK)
    organs = found_in(scene)
    assert [(organ.name, organ.kind) for organ in organs] == [("leaf_0", "sheet"), ("trunk", "rod")]
    held = table(scene, organs)
    assert held[0, 1] > 0.6
    assert held[1, 0] > 0.8
    assert max(held[0, 0], held[1, 1]) < 0.03


def test_leaves_that_cross_keep_their_identity() -> None:
    scene = together([leaf(0), leaf(50, place=(0.45, -0.45, 0.0), yaw=80.0, roll=50.0)])
    assert_each_has_its_own(scene, 0.5)


def test_leaves_from_one_foot_are_told_apart() -> None:
    scene = together([leaf(50 * k, yaw=120.0 * k + 5.0, pitch=35.0) for k in range(3)])
    assert_each_has_its_own(scene, 0.7)


def assert_each_has_its_own(scene: Labelled, least: float) -> None:
    """Every leaf is one found sheet, which holds most of it and hardly anything of another."""
    organs = found_in(scene)
    held = table(scene, organs)
    assert [organ.kind for organ in organs] == ["sheet"] * held.shape[1]
    own = held.argmax(axis=1)
    assert sorted(own) == list(range(held.shape[1]))
    assert held.max(axis=1).min() > least
    held[np.arange(len(own)), own] = 0.0
    assert held.max() < 0.05


@pytest.mark.parametrize(("ground", "floaters"), [(0.0, 0.0), (0.2, 0.05)])
def test_the_palm_has_five_leaves_and_a_trunk_without_any_region(ground: float, floaters: float) -> None:
    scene = palm(0, ground=ground, floaters=floaters)
    organs = found_in(scene)
    assert [organ.name for organ in organs] == list(scene.names)  # leaves by their direction, as they were planted
    held = table(scene, organs)
    assert np.diag(held).min() > 0.35
    assert held[5, 5] > 0.9
    assert (held - np.diag(np.diag(held))).max() < 0.03


def test_turned_and_scaled_clouds_have_the_same_organs() -> None:
    scene = together(LEAF_AND_TRUNK)
    turned = [
        PointCloud(points=0.01 * cloud.points[:, [1, 0, 2]] * [1, -1, 1] + 5, colors=cloud.colors, time=cloud.time)
        for cloud in scene.clouds
    ]
    organs = find_organs(turned, np.random.default_rng(0))
    assert [(organ.name, organ.kind) for organ in organs] == [("leaf_0", "sheet"), ("trunk", "rod")]


def test_nothing_stable_is_no_organ() -> None:
    rng = np.random.default_rng(0)
    clouds = [PointCloud(points=rng.uniform(size=(400, 3)), colors=np.zeros((400, 3)), time=0.0) for _ in range(20)]
    assert find_organs(clouds, rng) == ()
    empty = PointCloud(points=np.zeros((0, 3)), colors=np.zeros((0, 3)), time=0.0)
    assert find_organs([None, empty], rng) == ()


def test_a_floater_of_one_frame_has_no_cell() -> None:
    frames = [cloud.points for cloud in leaf(0)]
    blob = np.array([0.5, 0.0, 0.3]) + 0.02 * np.random.default_rng(0).normal(size=(800, 3))
    with_blob = stable_cells([*frames[:-1], np.vstack([frames[-1], blob])])
    assert np.count_nonzero(with_blob.numbers_of(blob) >= 0) < 0.05 * len(blob)
    assert np.count_nonzero(with_blob.numbers_of(frames[0]) >= 0) > 0.9 * len(frames[0])


def test_the_ground_goes_and_a_level_leaf_stays() -> None:
    rng = np.random.default_rng(1)
    soil = np.column_stack([rng.uniform(-1, 1, (3000, 2)), 0.003 * rng.normal(size=3000)])
    soil[:, 2] += 0.05 * soil[:, 0]
    stem = np.column_stack([0.03 * rng.normal(size=(3000, 2)), rng.uniform(0, 1.5, 3000)])
    (kept,) = without_ground([np.vstack([soil, stem])])
    assert len(kept) == pytest.approx(2900, abs=100)
    level = leaf(0)[0].points
    assert len(without_ground([level])[0]) == len(level)


def test_a_fork_has_three_branches_which_stay_apart_where_they_touch_again() -> None:
    rise = np.column_stack([np.zeros(60), np.zeros(60), np.arange(60)])
    arms = [np.column_stack([side * _bow(60), np.zeros(60), 60 + np.arange(60)]) for side in (-1, 1)]
    points = np.vstack([rise, *arms])
    cells = stable_cells([np.repeat(points, 30, axis=0)])
    branch, ways = branches(cells.links(), int(np.argmin(cells.centers[:, 2])), cells.side)
    of_point = branch[cells.numbers_of(points)]
    assert branch.max() == 2
    assert ways.max() == pytest.approx(125, rel=0.1)
    assert len(set(of_point[:55])) == 1
    assert {int(of_point[110]), int(of_point[170])} == {1, 2}
    np.testing.assert_array_equal(of_point[115:119], of_point[90])  # the ends meet, each stays its own


def _bow(count: int) -> np.ndarray:
    """From 0 out to 14 and back to 1."""
    return np.maximum(14 * np.sin(np.linspace(0, np.pi, count)), 1.0)


def test_one_smooth_sheet_is_smooth_and_two_are_not() -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(-1, 1, size=(900, 2))
    smooth = np.column_stack([xy, 0.2 * xy[:, 0] ** 3 - 0.1 * xy[:, 1]])
    step = np.column_stack([xy, 0.2 * (xy[:, 0] > 0)])
    assert roughness([smooth]) < 1e-4
    assert roughness([step]) > 0.005


def test_solidity_is_the_area_over_that_of_the_hull() -> None:
    grid = np.stack(np.meshgrid(np.arange(30), np.arange(30), [0.0]), axis=-1).reshape(-1, 3).astype(float)
    corner = grid[(grid[:, 0] < 15) | (grid[:, 1] < 15)]
    assert solidity(grid, 1.0) > 0.95
    assert solidity(corner, 1.0) == pytest.approx(6 / 7, abs=0.06)


def test_asked_for_organs_are_the_largest_of_their_kind() -> None:
    organs = found_in(together(LEAF_AND_TRUNK))
    given = [
        OrganSpec(name="blade", region="auto"),
        OrganSpec(name="mast", surface="cylinder", region="auto"),
        OrganSpec(name="everything"),
    ]
    chosen = assign(given, organs)
    assert {name: organ.name for name, organ in chosen.items()} == {"blade": "leaf_0", "mast": "trunk"}
    with pytest.raises(InvalidClouds, match="no sheet is left") as caught:
        assign([OrganSpec(name="a", region="auto"), OrganSpec(name="b", region="auto")], organs)
    assert caught.value.where == "/organs/b/region"


def test_one_organ_alone_is_the_whole_cloud() -> None:
    (whole,), places = specify(found_in(together([trunk(0)])))
    assert (whole.name, whole.surface, whole.region, dict(places)) == ("whole", "cylinder", None, {})
    (nothing,), _ = specify(())
    assert (nothing.name, nothing.surface) == ("whole", "polynomial")
