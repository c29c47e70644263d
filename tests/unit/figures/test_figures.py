"""Every picture shows the numbers it is made from: read back from the artists, not from pixels."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.figures import (
    camera_views,
    cloud,
    draw,
    eigenvalues,
    magnified_frames,
    modal_coordinates,
    mode_shapes,
    plant_views,
    principal_components,
    save,
)
from nerfmodal.figures.cameras import sides
from nerfmodal.figures.clouds import organ_labels
from nerfmodal.figures.eigenvalues import covariance_eigenvalues
from nerfmodal.figures.shapes import SWING, drawn_mode
from nerfmodal.figures.signals import MOST_FRAMES
from nerfmodal.figures.style import CYCLE, measured
from nerfmodal.types import ModalModel, Outcome, PointCloud
from PIL import ImageColor

from tests.fixtures.scans import LEAF_FREQUENCIES, TIMES, small_cloud, small_frame, small_result

RESULT = small_result()
LEAF, TRUNK = RESULT.organs


def texts(figure) -> str:
    panels = [text for axes in figure.axes for text in (axes.get_title(), axes.get_title(loc="left"))]
    return "\n".join([text.get_text() for text in figure.texts] + panels)


def without_modes(outcome: Outcome):
    none = ModalModel(
        frequencies=np.empty(0),
        frequency_stds=np.empty(0),
        damping_ratios=np.empty(0),
        damping_stds=np.empty(0),
        mode_shapes=np.empty((*LEAF.model.mode_shapes.shape[:2], 0)),
        coordinates=np.empty((len(TIMES), 0)),
        quality=(),
        outcome=outcome,
    )
    return replace(LEAF, model=none, reduction=None)


def test_mosaic_shows_at_most_twelve_views_and_names_their_cameras():
    frame = small_frame()
    figure = camera_views(frame)
    names = {camera.name for camera in frame.rig.cameras}
    assert len(figure.axes) == 12
    assert {axes.get_title() for axes in figure.axes} <= names
    np.testing.assert_array_equal(figure.axes[0].images[0].get_array(), frame.images[0])


def test_the_plant_is_shown_from_two_sides_that_differ():
    frame = small_frame()
    first, second = sides(frame)
    ways = [frame.rig.cameras[view].camera_to_world[:3, 2] for view in (first, second)]
    assert abs(ways[0][:2] @ ways[1][:2]) < 0.5
    assert max(abs(way[2]) for way in ways) < 0.6
    assert [axes.get_title() for axes in plant_views(frame).axes] == [
        frame.rig.cameras[view].name for view in (first, second)
    ]


def test_eigenvalues_sum_to_the_mean_square_displacement():
    frames = int(LEAF.displacement.valid.sum())
    values = LEAF.displacement.values[LEAF.displacement.valid].reshape(frames, -1)
    full = np.linalg.svd(values - values.mean(axis=0), compute_uv=False)
    organ = replace(LEAF, reduction=replace(LEAF.reduction, singular_values=full))
    expected = 1e6 * np.square(values - values.mean(axis=0)).sum() / ((frames - 1) * values.shape[1])
    assert covariance_eigenvalues(organ).sum() == pytest.approx(expected)


def test_kept_and_dropped_eigenvalues_are_told_apart_by_shape_not_by_colour_alone():
    kept, dropped = eigenvalues(LEAF).axes[0].lines
    assert len(kept.get_xdata()) == LEAF.reduction.scores.shape[1]
    assert kept.get_markerfacecolor() != dropped.get_markerfacecolor() == "white"


def test_coordinates_are_drawn_in_millimetres_with_the_lost_frame_left_out():
    drawn = modal_coordinates(LEAF, "free_decay").axes[0].lines[0].get_ydata()
    seen = LEAF.displacement.valid
    np.testing.assert_allclose(drawn[seen], 1e3 * LEAF.model.coordinates[seen, 0])
    assert np.isnan(drawn[~seen]).all()


def test_identified_frequency_and_its_interval_stand_in_the_spectrum():
    spectrum = modal_coordinates(LEAF, "free_decay").axes[1]
    band = spectrum.patches[0]
    assert spectrum.lines[1].get_xdata()[0] == pytest.approx(LEAF_FREQUENCIES[0])
    assert band.get_width() == pytest.approx(2 * 1.96 * LEAF.model.frequency_stds[0])


def test_numbers_stand_beside_the_picture_with_their_uncertainty_and_verdict():
    words = texts(modal_coordinates(LEAF, "free_decay"))
    assert "2.1700 ± 0.0030 Hz" in words
    assert "1.00 ± 0.12 %" in words
    assert "[rejected]" in words


def test_decay_envelope_is_drawn_for_a_free_decay_alone():
    decay, ambient = modal_coordinates(LEAF, "free_decay"), modal_coordinates(LEAF, "ambient")
    assert len(decay.axes[0].lines) == 3
    assert len(ambient.axes[0].lines) == 1


def test_envelope_of_a_clean_decay_is_its_own():
    clean = np.exp(-2 * np.pi * 2.17 * 0.01 * TIMES)
    wave = 0.04 * clean * np.cos(2 * np.pi * 2.17 * np.sqrt(1 - 1e-4) * TIMES)
    organ = replace(LEAF, model=replace(LEAF.model, coordinates=np.stack([wave] * 3, axis=1)))
    envelope = modal_coordinates(organ, "free_decay").axes[0].lines[1].get_ydata()
    np.testing.assert_allclose(envelope, 40 * clean, rtol=1e-6)


def test_of_a_long_record_the_beginning_is_drawn_and_the_label_says_so():
    times = np.arange(900) / 30
    wave = np.cos(2 * np.pi * 2.17 * times)
    coefficients = np.tile(LEAF.displacement.coefficients, (10, 1))
    displacement = replace(
        LEAF.displacement, coefficients=coefficients, times=times, valid=np.isfinite(coefficients).all(axis=1)
    )
    model = replace(LEAF.model, coordinates=np.stack([wave] * 3, axis=1))
    axes = modal_coordinates(replace(LEAF, displacement=displacement, model=model), "ambient").axes
    assert len(axes[0].lines[0].get_xdata()) == MOST_FRAMES
    assert axes[4].get_xlabel() == "time (s), the first 9.97 of 30 s"
    assert axes[1].lines[0].get_xdata()[1] == pytest.approx(30 / 890)  # ten frames are lost


def test_largest_swing_is_drawn_at_its_share_of_the_organ():
    mode = drawn_mode(TRUNK, 0)
    length = np.linalg.norm(np.ptp(TRUNK.displacement.sensors.positions, axis=0))
    swing = np.linalg.norm(mode.magnification * mode.motion, axis=1).max()
    assert swing == pytest.approx(SWING * length)


def test_world_motion_of_a_two_axis_shape_is_its_sum_over_directions():
    mode = drawn_mode(TRUNK, 0)
    at_height = (mode.rest[:, 2] / 2.5) ** 2
    np.testing.assert_allclose(mode.motion[:, :2], at_height[:, None] * [1.0, 0.1], atol=1e-9)
    np.testing.assert_allclose(mode.motion[:, 2], 0)


def test_points_take_the_organ_of_the_nearest_sensor_and_strays_take_none():
    points = small_cloud().points
    labels = organ_labels(points, (LEAF.displacement.sensors, TRUNK.displacement.sensors))
    leaf, trunk = (len(organ.displacement.sensors.positions) * 4 for organ in (LEAF, TRUNK))
    assert (labels[:leaf] == 0).mean() > 0.98
    assert (labels[leaf : leaf + trunk] == 1).mean() > 0.98
    assert (labels[leaf + trunk :] == -1).all()


@pytest.mark.parametrize("outcome", [Outcome.NO_MOTION, Outcome.TOO_FEW_FRAMES])
def test_an_organ_without_modes_says_why(outcome):
    organ = without_modes(outcome)
    pictures = (
        modal_coordinates(organ, "ambient"),
        mode_shapes(organ),
        magnified_frames(organ),
        principal_components(organ),
        eigenvalues(organ),
    )
    assert all(outcome.value in texts(figure) for figure in pictures)


def thinned(count: int, *, positions: np.ndarray | None = None):
    grid = LEAF.displacement.sensors
    places = grid.positions[:count] if positions is None else positions
    basis = LEAF.displacement.basis[: count * len(LEAF.displacement.directions)]
    displacement = replace(LEAF.displacement, basis=basis, sensors=replace(grid, positions=places))
    return replace(
        LEAF, displacement=displacement, model=replace(LEAF.model, mode_shapes=LEAF.model.mode_shapes[:count])
    )


@pytest.mark.parametrize(
    "organ",
    [
        thinned(4),
        thinned(4, positions=np.outer(np.arange(4.0), [1, 1, 0])),
        thinned(4, positions=np.zeros((4, 3))),
        replace(LEAF, model=replace(LEAF.model, coordinates=0 * LEAF.model.coordinates)),
        replace(LEAF, model=replace(LEAF.model, frequency_stds=np.full(3, np.nan), damping_stds=np.full(3, np.inf))),
    ],
    ids=["four sensors", "on a line", "in one place", "still", "uncertainty unknown"],
)
def test_poor_organs_are_drawn_too(organ, tmp_path: Path):
    assert len(draw(replace(RESULT, organs=(organ,)), None, None, tmp_path)) == 5 + 1 + 2 * 3


def test_organs_are_named_in_the_picture_of_the_cloud():
    panel = cloud(small_cloud(), RESULT).axes[1]
    assert {text.get_text() for text in panel.texts} == {"leaf_0", "trunk"}


def test_an_empty_cloud_says_why():
    empty = PointCloud(points=np.empty((0, 3)), colors=np.empty((0, 3)), time=0.0, outcome=Outcome.EMPTY_FIELD)
    assert Outcome.EMPTY_FIELD.value in texts(cloud(empty, RESULT))


def test_organ_colours_of_the_cloud_differ_in_hue_and_neighbours_differ_in_grey():
    grey = [np.dot(ImageColor.getrgb(colour), (0.299, 0.587, 0.114)) for colour in CYCLE]
    assert len(set(CYCLE)) == len(CYCLE)
    assert np.abs(np.diff(grey)).min() > 30


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [(2.17, 0.0031, "2.1700 ± 0.0031"), (1.0, 0.12, "1.00 ± 0.12"), (12.3, 4.4, "12.3 ± 4.4"), (5.0, 0.0, "5")],
)
def test_a_value_has_the_digits_its_uncertainty_allows(value, std, words):
    assert measured(value, std) == words


def test_album_has_every_picture_and_equal_results_give_equal_bytes(tmp_path: Path):
    result = replace(RESULT, organs=(TRUNK,))
    first = draw(result, small_frame(), small_cloud(), tmp_path / "a")
    again = draw(result, small_frame(), small_cloud(), tmp_path / "b")
    names = [path.name for path in first]
    assert names[:3] == ["plant.png", "cameras.png", "cloud.png"]
    whats = ("shapes", "coordinates", "magnified", "components", "eigenvalues")
    assert set(names[3:8]) == {f"trunk_{what}.png" for what in whats}
    assert names[8:] == ["trunk.json", "trunk_mode_0.mp4", "trunk_mode_0.gif"]
    for path, other in zip(first, again, strict=True):
        assert path.suffix == ".mp4" or path.read_bytes() == other.read_bytes()  # x264 promises no equal bytes


def test_a_figure_can_be_saved_as_vectors(tmp_path: Path):
    save(eigenvalues(LEAF), tmp_path / "eigenvalues.svg")
    assert (tmp_path / "eigenvalues.svg").read_text().lstrip().startswith("<?xml")
