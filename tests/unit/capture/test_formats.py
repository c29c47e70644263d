"""One film in every format opens to the same rig, times and pictures."""

from pathlib import Path

import numpy as np
import pytest
from nerfmodal.capture import Capture, open_capture
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Frame

from tests.fixtures.formats import FILMED, FORMATS, RATE, drawn, rig_of

CODEC_NOISE = 2.5
"""Grey levels of 255, root mean square: what H.264 at this quality and its chroma leave."""


@pytest.fixture(scope="module")
def film() -> list[Frame]:
    return drawn(frames=6)


def source(folder: Path, **options: object) -> CaptureSource:
    return CaptureSource.model_validate({"kind": "capture", "path": str(folder), **options})


def opened(folder: Path, kind: str) -> Capture:
    told = {"frame_rate_hz": RATE} if kind not in FILMED else {}
    return open_capture(source(folder, **told))


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_opens_to_the_same(tmp_path: Path, film: list[Frame], kind: str) -> None:
    if kind == "colmap binary":
        pytest.importorskip("pycolmap", reason="pycolmap is not installed: pip install 'nerfmodal[capture]'")
    FORMATS[kind](tmp_path, film)
    capture = opened(tmp_path, kind)
    np.testing.assert_allclose(capture.times, [one.time for one in film], atol=2e-5)
    assert capture.missing == ()
    assert capture.absent == ()
    capture.check(lambda *_: None)
    order = sorted(range(4), key=lambda k: film[0].rig.cameras[k].name)
    for here, true in zip(capture.rig.cameras, rig_of(film).cameras, strict=True):
        assert (here.name, here.width, here.height, here.model) == (true.name, true.width, true.height, "pinhole")
        lens = [here.focal_x, here.focal_y, here.center_x, here.center_y]
        np.testing.assert_allclose(lens, [true.focal_x, true.focal_y, true.center_x, true.center_y])
        np.testing.assert_allclose(here.camera_to_world, true.camera_to_world, atol=1e-9)
    for index in (4, 0, 5, 2):  # not in order: videos are sought
        frame = capture.read(index)
        difference = frame.images.astype(float) - film[index].images[order]
        assert np.sqrt((difference**2).mean()) <= (CODEC_NOISE if kind in FILMED else 0.0)


def test_times_from_0_to_1_need_a_rate(tmp_path: Path, film: list[Frame]) -> None:
    from nerfmodal.errors import InvalidCapture

    FORMATS["dnerf"](tmp_path, film)
    with pytest.raises(InvalidCapture, match="no frame rate") as caught:
        open_capture(source(tmp_path))
    assert "source.frame_rate_hz" in str(caught.value.hint)
