"""Where a scan's ground lies: what is said goes before what the pictures show; and frames without an organ."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal import field, pipeline
from nerfmodal.progress import Progress
from nerfmodal.scene import grounded, scene_of
from nerfmodal.spec import CaptureSource, ReconstructionSpec, ScanSpec
from nerfmodal.types import Frame

from tests.unit.field.test_ground import filmed

TOLD: list[str] = []


def tell(now: Progress) -> None:
    TOLD.append(now.message)


def a_capture(**reconstruction: object) -> ScanSpec:
    return ScanSpec(
        source=CaptureSource(kind="capture", path="anywhere"),
        reconstruction=ReconstructionSpec.model_validate(reconstruction),
    )


@pytest.fixture(scope="module")
def frame() -> Frame:
    return filmed((0.1, 0.06, -0.09))


def ground_of(spec: ScanSpec, frame: Frame) -> np.ndarray | None:
    return grounded(scene_of(spec, frame), spec, frame, report=tell).ground


def test_the_ground_of_a_capture_is_found_and_said(frame: Frame) -> None:
    ground = ground_of(a_capture(), frame)
    assert ground is not None
    np.testing.assert_allclose(ground, [0.1, 0.06, -0.09], atol=0.02)
    assert TOLD[-2:] == ["looking for the ground", f"the ground was found at z = {ground[0]:.3f} m"]


def test_what_is_said_of_the_ground_is_believed(frame: Frame, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field, "find_ground", lambda _: pytest.fail("the ground was looked for"))
    np.testing.assert_array_equal(ground_of(a_capture(ground_m=-0.4), frame), [-0.4, 0.0, 0.0])
    assert ground_of(a_capture(ground_m="none"), frame) is None


def test_where_frame_0_shows_nothing_frames_are_refitted(frame: Frame) -> None:
    """Plain pictures: an empty region, hence nothing to follow; the next frame is trained, and not taken for lost."""
    plain = replace(frame, images=np.full_like(frame.images, 90))
    spec = a_capture(ground_m="none", iterations=20, fine_tune_iterations=5, rays_per_batch=256, voxel_m=0.1)
    parent = pipeline.fit_first(spec, plain, report=tell)
    tuned = pipeline.fine_tune(spec, parent, plain, replace(plain, index=1), report=tell)
    assert tuned.field == "grid"
