"""`reproduce paper` with toy steps: a run that is killed goes on, and what is printed is what is stored."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from nerfmodal import __version__
from nerfmodal.spec import SimulationSource

from services.api.presets import PRESETS
from services.cli.reproduce import EXPERIMENTS, _begun, experiment, submitted
from tests.unit.cli.conftest import Call, stored

ROOT = Path(__file__).parents[3]
TOYS = {
    "NERFMODAL_TASKS": "tests.unit.cli.toy_tasks",
    "NERFMODAL_TICK_S": "0.1",
    "NERFMODAL_SLOTS": "2",
    "NERFMODAL_LEASE_S": "3",
}
COMMAND = ("reproduce", "paper", "--spec", "paper", "--frames", "16", "--renderer", "preview", "--out", "out")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_full_is_the_papers_own_and_small_keeps_its_record_and_motion(name: str) -> None:
    assert experiment(name, "full", 0, "blender", None) == PRESETS[name]
    small = experiment(name, "small", 3, "blender", None)
    source, paper = small.source, PRESETS[name].source
    assert isinstance(source, SimulationSource)
    assert isinstance(paper, SimulationSource)
    assert (source.motion, source.frames, source.frame_rate_hz, small.seed) == (paper.motion, 90, 30, 3)
    assert source.rig.width_px < paper.rig.width_px


def test_a_name_that_is_no_experiment_is_refused(call: Call) -> None:
    done = call("reproduce", "paper", "--spec", "papr")
    assert done.exit_code == 3
    assert "paper-off-bin" in done.stderr


@pytest.mark.parametrize(("status", "retried"), [("running", []), ("failed", ["s"]), ("canceled", ["s"])])
def test_a_scan_that_failed_is_tried_again(status: str, retried: list[str]) -> None:
    calls: list[str] = []

    class Service:
        def submit(self, spec: object, key: str) -> SimpleNamespace:
            del spec
            assert key == f"reproduce-{small.digest()}"
            return SimpleNamespace(id="s", status=status)

        def retry(self, scan: str) -> SimpleNamespace:
            calls.append(scan)
            return SimpleNamespace(id=scan, status="queued")

    small = experiment("paper", "small", 0, "preview", 16)
    assert submitted(Service(), small).id == "s"  # type: ignore[arg-type]
    assert calls == retried


def test_what_another_command_or_specification_stored_is_not_taken(tmp_path: Path) -> None:
    done = [{"spec_digest": "old"}, {"spec_digest": "same"}]
    stored = {"command": "c", "version": __version__, "experiments": done}
    (tmp_path / "reproduction.json").write_text(json.dumps(stored))
    assert _begun(tmp_path, "c", {"same", "new"})["experiments"] == [{"spec_digest": "same"}]
    assert _begun(tmp_path, "another", {"same"})["experiments"] == []


def test_a_run_that_is_killed_goes_on_with_the_same_scan(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for key, value in TOYS.items():
        monkeypatch.setenv(key, value)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "libs")])}
    command = [sys.executable, "-m", "services.cli.main", *COMMAND]
    with (tmp_path / "log").open("w") as log:
        killed = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=log, stderr=log)
        deadline = time.monotonic() + 60
        while "frame." not in (tmp_path / "log").read_text() and time.monotonic() < deadline:
            time.sleep(0.05)
        killed.send_signal(signal.SIGKILL)
        killed.wait()
    assert not (tmp_path / "out/reproduction.json").exists()
    done = call(*COMMAND)
    assert done.exit_code == 0, done.output
    document = stored(tmp_path / "out/reproduction.json")
    assert document["resumed"]
    assert [one["name"] for one in document["experiments"]] == ["paper"]
    assert not (tmp_path / "out/.service").exists()
    again = call(*COMMAND, "--json")
    assert json.loads(again.stdout)["experiments"] == document["experiments"]
