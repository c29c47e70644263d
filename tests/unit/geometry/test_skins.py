"""Skins join neighbours, span no hole, and are closed round a rod."""

import numpy as np
import pytest
from nerfmodal.geometry.skins import MOST_RINGS, SIDES, edges, outline, rod_order, sheet, sheet_triangles, tube


def test_triangles_do_not_span_a_hole_and_the_outline_runs_round_it():
    x, y = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    solid = sheet_triangles(points)
    holed = points[np.linalg.norm(points[:, :2] - 0.5, axis=1) > 0.3]
    centres = holed[sheet_triangles(holed)].mean(axis=1)
    assert len(solid) == 800
    assert len(outline(solid)) == 80
    assert np.linalg.norm(centres[:, :2] - 0.5, axis=1).min() > 0.25


def test_a_sheet_keeps_an_even_choice_of_its_sensors():
    points = np.random.default_rng(0).normal(size=(500, 3)) * [1, 1, 0]
    skin = sheet(points, most=50)
    assert (len(skin.sensor), skin.sensor[0], skin.sensor[-1]) == (50, 0, 499)
    np.testing.assert_array_equal(skin.vertices, points[skin.sensor])


@pytest.mark.parametrize("points", [np.zeros((4, 3)), np.outer(np.arange(9.0), [1, 1, 0]), np.eye(3)])
def test_points_that_are_no_sheet_have_no_triangles(points: np.ndarray):
    assert sheet_triangles(points).shape == (0, 3)


def test_a_tube_is_closed_around_and_open_at_its_ends():
    heights = np.random.default_rng(1).permutation(np.linspace(0, 2, 200))
    skin = tube(np.outer(heights, [0.3, 0, 1]))
    ends = outline(skin.triangles)
    rings = len(skin.vertices) // SIDES
    assert rings == MOST_RINGS
    assert len(ends) == 2 * SIDES
    assert len(edges(skin.triangles)) == rings * SIDES + 2 * (rings - 1) * SIDES
    assert (np.diff(heights[skin.sensor[::SIDES]]) > 0).all() or (np.diff(heights[skin.sensor[::SIDES]]) < 0).all()


def test_order_along_a_rod_is_that_of_its_length():
    heights = np.array([0.3, 0.1, 0.9, 0.5])
    order = rod_order(np.outer(heights, [0, 0.6, 0.8]) + 5)
    assert list(heights[order]) in ([0.1, 0.3, 0.5, 0.9], [0.9, 0.5, 0.3, 0.1])
