"""A followed point is one organ's, also where boxes overlap: a stem does not move with the leaves before it."""

import numpy as np
from nerfmodal.allotment import measuring
from nerfmodal.spec import OrganSpec, OrientedBox
from nerfmodal.types import PointCloud

RNG = np.random.default_rng(4)
FRAMES = 12
LEAF = RNG.uniform([0.02, -0.2, 0.30], [0.50, 0.2, 0.32], (900, 3))
TURN, RISE = RNG.uniform(0, 2 * np.pi, 900), RNG.uniform(0, 0.6, 900)
STEM = np.column_stack([0.01 * np.cos(TURN), 0.01 * np.sin(TURN), RISE])
SWING = np.sin(np.arange(FRAMES))
ORGANS = (
    OrganSpec(name="leaf", region=OrientedBox(center_m=(0.27, 0, 0.31), size_m=(0.51, 0.42, 0.06))),
    OrganSpec(
        name="stem",
        region=OrientedBox(center_m=(0, 0, 0.3), size_m=(0.9, 0.9, 0.7)),
        surface="cylinder",
        degree=2,
        sensors=50,
    ),
)


def clouds() -> list[PointCloud]:
    """The leaf swings upwards by 3 cm, the stem aside by 1 cm at its tip."""
    both = np.concatenate([LEAF, STEM])
    made = []
    for swing in SWING:
        moved = both.copy()
        moved[: len(LEAF), 2] += 0.03 * swing
        moved[len(LEAF) :, 0] += 0.01 * swing * STEM[:, 2] / 0.6
        made.append(PointCloud(points=moved, colors=np.zeros_like(both), time=0.0, stds=np.full(len(both), 1e-4)))
    return made


def displacement_of(organ: OrganSpec, organs: tuple[OrganSpec, ...]) -> np.ndarray:
    track = measuring(organs, {})(
        organ,
        clouds(),
        reference="mean",
        times=np.arange(FRAMES) / 30,
        frame_rate=30.0,
        rng=np.random.default_rng(0),
        report=lambda *_: None,
    )
    return track.displacement.values


def test_a_stem_does_not_move_with_the_leaves_in_its_box() -> None:
    values = displacement_of(ORGANS[1], ORGANS)
    expected = 0.01 * (SWING - SWING.mean())
    np.testing.assert_allclose(np.abs(values[..., 0]).max(axis=1), np.abs(expected) * 0.95, atol=1e-3)
    assert np.abs(values[..., 2]).max() < 1e-3  # the leaf's 3 cm


def test_an_organ_given_on_top_of_others_has_their_points() -> None:
    whole = OrganSpec(name="whole")
    values = displacement_of(whole, (*ORGANS, whole))
    assert np.abs(values[..., 2]).max() > 0.01
