"""A sheet whose motion is known: it is found in three components, or the frame is lost for a reason."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.tracking import Loss, Reference, follow, reference_arrays, reference_of
from nerfmodal.types import Rig

from tests.fixtures.sheets import HALF, Motion, Sheet, reference_for

FOOTPRINT = 0.0174
"""Of a pixel at the sheet's middle, metres."""


@pytest.fixture(scope="module")
def sheet() -> Sheet:
    return Sheet()


@pytest.fixture(scope="module")
def reference(sheet: Sheet) -> Reference:
    return reference_for(sheet)


def rigid(points: np.ndarray) -> np.ndarray:
    return np.broadcast_to([0.012, -0.008, 0.02], points.shape).copy()


def slightly_rigid(points: np.ndarray) -> np.ndarray:
    return 0.05 * rigid(points) / 0.24


def bent(points: np.ndarray) -> np.ndarray:
    share = (points[:, 0] + HALF[0]) / (2 * HALF[0])
    return np.stack([0 * share, 0 * share, 0.05 * share**2], axis=1)


def twisted(points: np.ndarray) -> np.ndarray:
    share = (points[:, 0] + HALF[0]) / (2 * HALF[0])
    return np.stack([0 * share, 0 * share, 0.2 * points[:, 1] * share], axis=1)


@pytest.mark.parametrize("motion", [rigid, bent, twisted])
def test_known_motion_is_found_to_a_few_hundredths_of_a_pixel(
    sheet: Sheet, reference: Reference, motion: Motion
) -> None:
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), sheet.frame(1, motion))
    error = found.points - reference.cloud - motion(reference.cloud)
    assert not found.losses
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.08 * FOOTPRINT


def test_a_small_motion_is_neither_stretched_nor_shrunk(sheet: Sheet, reference: Reference) -> None:
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), sheet.frame(1, slightly_rigid))
    truth = slightly_rigid(reference.cloud)
    gain = ((found.points - reference.cloud) * truth).sum() / (truth**2).sum()
    assert gain == pytest.approx(1.0, abs=0.03)


def test_the_same_pictures_are_no_motion(sheet: Sheet, reference: Reference) -> None:
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), sheet.frame(0))
    assert np.abs(found.points - reference.cloud).max() < 1e-3 * FOOTPRINT


def test_a_change_of_light_is_not_taken_for_motion(sheet: Sheet, reference: Reference) -> None:
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), sheet.frame(1, rigid, light=1.3))
    error = found.points - reference.cloud - rigid(reference.cloud)
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.15 * FOOTPRINT


def test_the_error_is_within_what_is_said_of_it(sheet: Sheet, reference: Reference) -> None:
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), sheet.frame(1, bent))
    error = found.points - reference.cloud - bent(reference.cloud)
    size = np.sqrt((error**2).mean())
    assert 0.2 < size / np.sqrt((found.stds**2).mean()) < 3.0


def test_a_camera_that_lost_its_picture_is_done_without(sheet: Sheet, reference: Reference) -> None:
    frame = sheet.frame(1, rigid)
    kept = replace(frame, images=frame.images[1:], rig=Rig(cameras=frame.rig.cameras[1:]))
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), kept)
    error = found.points - reference.cloud - rigid(reference.cloud)
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.1 * FOOTPRINT


def test_two_cameras_are_too_few(sheet: Sheet, reference: Reference) -> None:
    frame = sheet.frame(1, rigid)
    kept = replace(frame, images=frame.images[:2], rig=Rig(cameras=frame.rig.cameras[:2]))
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), kept)
    assert found.losses == {"leaf": Loss.OUT_OF_SIGHT}
    assert np.isinf(found.stds).all()
    np.testing.assert_array_equal(found.points, reference.cloud)


def test_a_sheet_that_something_hides_is_lost(sheet: Sheet, reference: Reference) -> None:
    found = follow(reference, sheet.backgrounds(), sheet.frame(0), sheet.frame(1, rigid, hidden=True))
    assert found.losses == {"leaf": Loss.UNEXPLAINED}


def test_a_sheet_without_texture_in_its_walls_colour_is_lost() -> None:
    sheet = Sheet(texture=0.0, wall=0.0)
    plain = replace(sheet.frame(0), images=np.full_like(sheet.frame(0).images, 120))
    reference = reference_for(sheet)
    found = follow(reference, plain.images, plain, replace(plain, index=1))
    assert found.losses == {"leaf": Loss.TEXTURELESS}


def test_a_reference_survives_a_checkpoint(reference: Reference) -> None:
    again = reference_of(reference_arrays(reference))
    assert again.organs == reference.organs
    for name in ("flat", "organ", "points", "trust", "unrest", "opacity", "cloud", "colors", "owner"):
        np.testing.assert_array_equal(getattr(again, name), getattr(reference, name))
