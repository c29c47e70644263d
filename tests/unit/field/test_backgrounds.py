"""What is hidden of a floor is taken from the pictures that show it: a smooth pattern, filmed exactly."""

import numpy as np
import pytest
from nerfmodal.field import backgrounds
from nerfmodal.field.backgrounds import ground_behind, presumed_backgrounds, remaining, spread
from nerfmodal.field.beyond import shared_ground
from nerfmodal.field.grid import GridField, empty_field
from nerfmodal.field.views import views_of
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.geometry.rays import rig_directions
from nerfmodal.spec import RigSpec
from nerfmodal.types import Frame, Rig

HEIGHT = -0.2
SIDE = 64
FLOOR = np.array([HEIGHT, 0.0, 0.0])


@pytest.fixture(scope="module")
def floor() -> Frame:
    """A floor of waves half a metre long, several pixels wide wherever they are seen."""
    rig = semi_spherical_rig(
        RigSpec(cameras=9, width_px=SIDE, height_px=SIDE, radius_m=2.5, target_m=(0, 0, 0), lowest_deg=35)
    )
    pictures = []
    for camera, directions in zip(rig.cameras, rig_directions(rig), strict=True):
        origin = camera.camera_to_world[:3, 3]
        falls = np.minimum(directions[:, 2], -1e-2)
        x, y = (origin + ((HEIGHT - origin[2]) / falls)[:, None] * directions)[:, :2].T
        waves = np.stack([np.sin(2 * np.pi * x / 0.5), np.sin(2 * np.pi * y / 0.5), np.sin(2 * (x + y))], axis=1)
        pictures.append(np.round(127.5 + 100 * waves))
    images = np.stack(pictures).astype(np.uint8).reshape(9, SIDE, SIDE, 3)
    return Frame(index=0, time=0.0, images=images, rig=rig)


def test_a_hidden_place_is_read_from_the_camera_that_sees_it(floor: Frame) -> None:
    clear = np.ones(floor.images.shape[:3], dtype=bool)
    clear[:, 20:44, 28:36] = False
    filled = list(ground_behind(FLOOR, floor.rig, views_of(floor), clear))
    flat = np.concatenate([numbers for numbers, _ in filled])
    off = np.concatenate([colors for _, colors in filled]).astype(float) - floor.images.reshape(-1, 3)[flat]
    assert set(flat) <= set(np.flatnonzero(~clear))
    assert len(flat) > 0.7 * (~clear).sum()  # under the rig's target nobody sees it
    assert np.median(np.abs(off)) < 3
    assert np.sqrt(np.mean(off**2)) < 12  # the pattern's own is 70


@pytest.mark.parametrize("step", [1, 4, 7])
def test_what_is_said_of_some_pixels_is_said_of_those_after_them(floor: Frame, step: int) -> None:
    views = views_of(Frame(index=0, time=0.0, images=floor.images[:, :9, :62], rig=floor.rig))
    numbers = np.arange(9 * 62).reshape(1, 9, 62)
    everywhere = spread(numbers[:, ::step, ::step], step, views)
    rows, columns = np.indices((9, 62))
    np.testing.assert_array_equal(everywhere[0], (rows // step * step) * 62 + columns // step * step)


@pytest.mark.parametrize("step", [1, 2, 5])
def test_only_some_pixels_are_asked_for(floor: Frame, step: int) -> None:
    clear = np.ones(floor.images.shape[:3], dtype=bool)
    clear[:, 20:44, 28:36] = False
    flat = np.concatenate([numbers for numbers, _ in ground_behind(FLOOR, floor.rig, views_of(floor), clear, step)])
    _, rows, columns = np.unravel_index(flat, clear.shape)
    assert not (rows % step).any()
    assert not (columns % step).any()
    assert len(flat) > 0.5 * (~clear[:, ::step, ::step]).sum()


def test_of_very_many_pixels_some_are_asked_for(floor: Frame, fog: GridField, monkeypatch: pytest.MonkeyPatch) -> None:
    views = views_of(floor)
    left = remaining(fog, views)
    shared = shared_ground(fog, views)
    fine = presumed_backgrounds(fog, floor.rig, views, shared, left, foggy=False)
    monkeypatch.setattr(backgrounds, "ASKED_FOR", views.pixels // 4)
    coarse = presumed_backgrounds(fog, floor.rig, views, shared, left, foggy=False)
    hidden = (left < 0.9)[:, ::2, ::2]
    assert hidden.any()
    np.testing.assert_array_equal(fine[:, ::2, ::2][hidden], coarse[:, ::2, ::2][hidden])
    assert not np.array_equal(fine, coarse)


def test_nothing_is_said_of_what_nobody_sees(floor: Frame) -> None:
    assert not list(ground_behind(FLOOR, floor.rig, views_of(floor), np.zeros(floor.images.shape[:3], dtype=bool)))


def test_a_camera_that_sees_nothing_borrows_everything(floor: Frame) -> None:
    """One camera hides everything: each of its pixels shows what another one sees there."""
    clear = np.ones(floor.images.shape[:3], dtype=bool)
    clear[0] = False
    dark = Frame(index=0, time=0.0, rig=floor.rig, images=np.where(clear[..., None], floor.images, 0).astype(np.uint8))
    filled = list(ground_behind(FLOOR, dark.rig, views_of(dark), clear))
    flat = np.concatenate([numbers for numbers, _ in filled])
    off = np.concatenate([colors for _, colors in filled]).astype(float) - floor.images.reshape(-1, 3)[flat]
    assert (flat < SIDE * SIDE).all()
    assert np.median(np.abs(off)) < 3


@pytest.fixture(scope="module")
def fog() -> GridField:
    """A field over the floor's middle of which nothing is known yet."""
    return empty_field(np.full(3, -0.19), np.full(3, 0.21), 0.05, FLOOR, 9 * SIDE**2)


def test_ground_is_shared_where_three_cameras_see_it(floor: Frame, fog: GridField) -> None:
    views = views_of(floor)
    shared = shared_ground(fog, views)
    assert shared[:, SIDE // 2, SIDE // 2].all()  # all look there
    assert not shared.all()
    two = Frame(index=0, time=0.0, images=floor.images[:2], rig=Rig(cameras=floor.rig.cameras[:2]))
    assert not shared_ground(fog, views_of(two)).any()


def test_what_no_picture_shows_is_guessed_from_around(floor: Frame, fog: GridField) -> None:
    """Every picture is plain, each in its own tone, and the structure is black."""
    tones = np.linspace(60, 220, 9).astype(np.uint8)[:, None, None, None]
    images = np.broadcast_to(tones, floor.images.shape).copy()
    images[:, 28:36, 28:36] = 0
    views = views_of(Frame(index=0, time=0.0, images=images, rig=floor.rig))
    nowhere = np.zeros(images.shape[:3], dtype=bool)
    behind = presumed_backgrounds(fog, floor.rig, views, nowhere, remaining(fog, views), foggy=False)
    middle = behind[:, 30:34, 30:34].astype(int)
    own = np.abs(middle - tones).max(axis=(1, 2, 3))
    other = np.abs(middle[..., None] - tones.ravel()).min(axis=(1, 2, 3, 4))
    assert (np.minimum(own, other) < 6).all()  # of its own picture, or what another shows of the place
    assert (middle > 50).all()


def test_fog_before_its_own_background_is_seen_through(floor: Frame, fog: GridField) -> None:
    """Fog over a plain floor, which the field has learned: the pictures themselves are behind it."""
    plain = np.full_like(floor.images, 128)
    plain[:, ::2] = 132
    views = views_of(Frame(index=0, time=0.0, images=plain, rig=floor.rig))
    everywhere = np.ones(plain.shape[:3], dtype=bool)
    left = remaining(fog, views)
    hidden = presumed_backgrounds(fog, floor.rig, views, everywhere, left, foggy=False)
    seen = presumed_backgrounds(fog, floor.rig, views, everywhere, left, foggy=True)
    np.testing.assert_array_equal(seen, plain)
    assert not np.array_equal(hidden, plain)
