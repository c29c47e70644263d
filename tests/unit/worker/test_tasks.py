"""The tasks load, call one stage of the pipeline, and save: what goes in is what the parents made."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal import io, pipeline
from nerfmodal.progress import Progress
from nerfmodal.spec import ScanSpec
from nerfmodal.types import Camera, Checkpoint, Frame, PointCloud, Rig
from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, READ, RENDER, TRAIN
from scanjobs.plan import WHOLE_SCAN

from services.worker.job import GivenFile, Job, Produced
from services.worker.tasks import TASKS
from tests.integration.toy_service import toy_spec

RIG = Rig(
    cameras=(
        Camera(
            name="a",
            width=4,
            height=3,
            focal_x=5.0,
            focal_y=5.0,
            center_x=2.0,
            center_y=1.5,
            camera_to_world=np.eye(4),
        ),
    )
)
FIRST = Frame(index=0, time=0.0, images=np.full((1, 3, 4, 3), 7, np.uint8), rig=RIG)
SECOND = replace(FIRST, index=1, time=0.5, images=np.full((1, 3, 4, 3), 9, np.uint8))
SHARED = Checkpoint(field="grid", frame_index=0, step=10, parent=None, state={"density": np.ones(3)}, psnr=20.0)
TUNED = replace(SHARED, frame_index=1, parent=0, step=5, psnr=30.0, held_out_psnr=25.0)
CLOUD = PointCloud(points=np.array([[0.0, 1.0, 2.0]]), colors=np.array([[0.0, 1.0, 0.0]]), time=0.5)


def quiet(_: Progress) -> None:
    """Report to nobody."""


def run(kind: str, frame: int, folder: Path, given: Sequence[GivenFile] = (), spec: ScanSpec | None = None) -> Produced:
    """Run one task."""
    job = Job(kind=kind, frame=frame, spec=spec or toy_spec(frames=3), inputs=tuple(given), out=folder)
    return TASKS[kind](job, quiet)


@pytest.fixture
def given(tmp_path: Path) -> dict[str, GivenFile]:
    """What the parents have made, as files."""
    (tmp_path / "in").mkdir()
    files = {
        "first": GivenFile(kind=RENDER, frame=0, role="frame", path=tmp_path / "in" / "frame_0000.zip"),
        "second": GivenFile(kind=RENDER, frame=1, role="frame", path=tmp_path / "in" / "frame_0001.zip"),
        "shared": GivenFile(kind=TRAIN, frame=WHOLE_SCAN, role="checkpoint", path=tmp_path / "in" / "a.safetensors"),
        "tuned": GivenFile(kind=TRAIN, frame=1, role="checkpoint", path=tmp_path / "in" / "b.safetensors"),
        "cloud": GivenFile(kind=EXTRACT, frame=1, role="cloud", path=tmp_path / "in" / "cloud_0001.ply"),
    }
    io.write_frame(files["first"].path, FIRST)
    io.write_frame(files["second"].path, SECOND)
    io.write_checkpoint(files["shared"].path, SHARED)
    io.write_checkpoint(files["tuned"].path, TUNED)
    io.write_cloud(files["cloud"].path, CLOUD)
    return files


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[Any, ...]]:
    """The stages of the pipeline, replaced by ones that note what they were given."""
    noted: dict[str, tuple[Any, ...]] = {}

    def stage(name: str, answer: Any) -> None:
        def called(_spec: ScanSpec, *values: Any, **_: Any) -> Any:
            noted[name] = values
            return answer(*values) if callable(answer) else answer

        monkeypatch.setattr(pipeline, name, called)

    def written(*values: Any) -> tuple[Path, ...]:
        path = Path(values[-1]) / "pictures" / "report.html"
        path.parent.mkdir()
        path.write_text("report")
        return (path,)

    stage("make_frame", lambda index: FIRST if index == 0 else SECOND)
    stage("write_truth", lambda path: path.write_bytes(b"truth"))
    stage("write_depths", lambda index, path: path.write_bytes(b"depths") > 0 and index == 1)
    stage("fit_first", SHARED)
    stage("fine_tune", TUNED)
    stage("extract", CLOUD)
    stage("identify", "result")
    stage("publish", written)
    stage("open_source", None)
    stage("check_source", None)
    stage("frame_times", (0.0, 0.5, 1.0))
    stage("read_clouds", lambda: iter((CLOUD, CLOUD)))
    return noted


@pytest.mark.usefixtures("calls")
def test_first_frame_comes_with_the_truth_and_each_with_the_depths_that_are_asked_for(tmp_path: Path) -> None:
    assert [one.role for one in run(RENDER, 0, tmp_path).files] == ["frame", "truth"]
    made = run(RENDER, 1, tmp_path).files
    assert [(one.role, one.path.name) for one in made] == [("frame", "frame_0001.zip"), ("depth", "depth_0001.npz")]
    assert np.array_equal(io.read_frame(made[0].path).images, SECOND.images)


@pytest.mark.usefixtures("calls")
def test_read_frame_is_only_a_frame(tmp_path: Path) -> None:
    assert [one.role for one in run(READ, 0, tmp_path).files] == ["frame"]


def test_shared_checkpoint_is_trained_from_frame_0(
    tmp_path: Path, given: dict[str, GivenFile], calls: dict[str, tuple[Any, ...]]
) -> None:
    made = run(TRAIN, WHOLE_SCAN, tmp_path, [given["first"]])
    assert calls["fit_first"][0].index == 0
    assert io.read_checkpoint(made.files[0].path).step == SHARED.step
    assert "fine_tune" not in calls


def test_frame_is_tuned_from_the_shared_checkpoint(
    tmp_path: Path, given: dict[str, GivenFile], calls: dict[str, tuple[Any, ...]]
) -> None:
    made = run(TRAIN, 1, tmp_path, [given["second"], given["shared"], given["first"]])
    parent, first, frame = calls["fine_tune"]
    assert (parent.parent, first.index, frame.index) == (None, 0, 1)
    rays = 5 * toy_spec().reconstruction.rays_per_batch
    assert made.facts == {"iterations": 5, "rays": rays, "psnr": 30.0, "held_out_psnr": 25.0}


def test_frame_0_is_tuned_like_every_other(
    tmp_path: Path, given: dict[str, GivenFile], calls: dict[str, tuple[Any, ...]]
) -> None:
    run(TRAIN, 0, tmp_path, [given["first"], given["shared"]])
    parent, first, frame = calls["fine_tune"]
    assert (parent.step, first.index, frame.index) == (SHARED.step, 0, 0)


def test_cloud_comes_from_the_frame_s_own_checkpoint(
    tmp_path: Path, given: dict[str, GivenFile], calls: dict[str, tuple[Any, ...]]
) -> None:
    made = run(EXTRACT, 1, tmp_path, [given["second"], given["tuned"]])
    checkpoint, frame = calls["extract"]
    assert (checkpoint.psnr, frame.index) == (30.0, 1)
    assert made.facts == {"points": 1, "outcome": "OK"}
    assert io.read_cloud(made.files[0].path).time == CLOUD.time


def test_lost_frames_are_gaps_in_the_clouds(
    tmp_path: Path, given: dict[str, GivenFile], calls: dict[str, tuple[Any, ...]]
) -> None:
    made = run(IDENTIFY, WHOLE_SCAN, tmp_path, [given["first"], given["cloud"]])
    clouds = calls["identify"][0]
    assert [None if cloud is None else cloud.time for cloud in clouds] == [None, 0.5, None]
    result, frame, cloud, _ = calls["publish"]
    assert (result, frame.index, cloud.time) == ("result", 0, 0.5)
    assert [one.role for one in made.files] == ["pictures/report.html"]
    assert made.facts == {"lost_frames": [0, 2]}


def test_modes_so_far_say_what_they_are_of_and_are_no_result(
    tmp_path: Path, given: dict[str, GivenFile], calls: dict[str, tuple[Any, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the first two of three frames, of which frame 0 was lost: later clouds are not there yet, and no loss."""

    def told(_spec: ScanSpec, result: str, frames: int, out: Path) -> Path:
        (out / "modes.json").write_text(f"{result} of {frames}")
        return out / "modes.json"

    monkeypatch.setattr(pipeline, "publish_so_far", told)
    made = run(IDENTIFY, 2, tmp_path, [given["cloud"]])
    assert [None if cloud is None else cloud.time for cloud in calls["identify"][0]] == [None, 0.5, None]
    assert [(one.role, one.path.read_text()) for one in made.files] == [("so_far/modes.json", "result of 2")]
    assert made.facts == {"partial": True, "frames": 2, "lost_frames": [0]}
    assert "publish" not in calls


def test_clouds_of_any_sensor_are_identified_without_a_frame(tmp_path: Path, calls: dict[str, tuple[Any, ...]]) -> None:
    spec = ScanSpec.model_validate({"source": {"kind": "clouds", "path": "x"}})
    run(IDENTIFY, WHOLE_SCAN, tmp_path, spec=spec)
    assert len(calls["identify"][0]) == 2
    assert calls["publish"][1] is None


@pytest.mark.parametrize(("source", "frames"), [("capture", 3), ("clouds", 0)])
@pytest.mark.usefixtures("calls")
def test_inspection_counts_the_frames(tmp_path: Path, source: str, frames: int) -> None:
    spec = ScanSpec.model_validate({"source": {"kind": source, "path": "x"}})
    assert run(INSPECT, WHOLE_SCAN, tmp_path, spec=spec) == Produced(files=(), facts={"frames": frames})


def test_step_without_what_it_needs_says_so(tmp_path: Path) -> None:
    with pytest.raises(LookupError, match="no checkpoint of frame 1"):
        run(EXTRACT, 1, tmp_path)
