"""The demo and `up` as real processes: toy steps, everything else as a user has it."""

import json
import os
import subprocess
import sys
import time
import uuid
from pathlib import Path

import httpx
import pytest

from services.cli.address import announced
from services.cli.service_process import MARK, ServiceLeftProcesses, processes_with, running_service
from tests.unit.cli.conftest import SPEC, Call, stored

RUN = "NERFMODAL_TEST_RUN"
TOYS = {
    "NERFMODAL_TASKS": "tests.unit.cli.toy_tasks",
    "NERFMODAL_TICK_S": "0.1",
    "NERFMODAL_SLOTS": "2",
    RUN: uuid.uuid4().hex,
}
ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    for key, value in TOYS.items():
        monkeypatch.setenv(key, value)


def left_running() -> list[int]:
    """Processes that a service of this test run started."""
    return processes_with(RUN, TOYS[RUN])


def test_the_demo_compares_cleans_up_and_leaves_nothing_running(call: Call, spec: Path, tmp_path: Path) -> None:
    done = call("demo", "--spec", spec, "--out", "out/demo")
    assert done.exit_code == 0, done.output
    assert "leaf_0" in done.stdout
    assert "comparison.json" in done.stdout
    assert "frame.render 3/3" in done.stderr
    rows = stored(tmp_path / "out/demo/comparison.json")
    matched = [row for row in rows if row["mac"] is not None]
    assert {row["organ"] for row in rows} == {"leaf_0", "trunk"}
    assert all(row["truth_hz"] == row["found_hz"] and row["mac"] > 0.999 for row in matched)
    assert (tmp_path / "out/demo/shapes/trunk_0.npz").exists()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["demo"]
    assert left_running() == []


def test_a_failed_scan_is_1_and_keeps_what_the_service_wrote(call: Call, spec: Path) -> None:
    spec.write_text(SPEC + "tags: [broken]\n")
    done = call("demo", "--spec", spec, "--out", "out/demo")
    assert done.exit_code == 1
    assert "failed at frame.render: /tags: the toy is broken. Mend the toy." in done.stderr
    kept = Path(done.stderr.split("is kept in ")[1].splitlines()[0])
    assert (kept / "service.log").exists()
    assert left_running() == []


def test_an_interrupted_service_takes_its_runners_along(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), running_service(tmp_path / "data", tmp_path / "log") as service:
        httpx.post(f"{service.address}/v1/scans", json={"source": {"kind": "clouds", "path": "."}})
        raise KeyboardInterrupt
    assert left_running() == []
    assert announced(tmp_path / "data") is None


def test_what_a_service_leaves_behind_is_found_and_killed(tmp_path: Path) -> None:
    """A process in a session of its own, as a runner that nobody asked to end."""
    with (
        pytest.raises(ServiceLeftProcesses) as left,
        running_service(tmp_path / "data", tmp_path / "log") as service,
    ):
        inherited = Path(f"/proc/{service.pid}/environ").read_bytes().split(b"\0")
        [mark] = [item.decode().partition("=")[2] for item in inherited if item.startswith(MARK.encode())]
        orphan = subprocess.Popen(["sleep", "60"], env={MARK: mark}, start_new_session=True)
    assert str(orphan.pid) in str(left.value)
    assert orphan.wait(5) == -9


def test_a_service_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    data = tmp_path / "data"
    code = (
        "import os, sys; from pathlib import Path\n"
        "from services.cli.service_process import running_service\n"
        f"with running_service(Path({str(data)!r}), Path({str(tmp_path / 'log')!r})) as s:\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, env={**os.environ, **TOYS})
    deadline = time.monotonic() + 20
    while announced(data) is not None and time.monotonic() < deadline:
        time.sleep(0.1)
    assert announced(data) is None


def test_a_service_guards_its_folder_its_port_and_its_name(tmp_path: Path) -> None:
    with running_service(tmp_path / "data", tmp_path / "log") as service:
        second = subprocess.run(
            [sys.executable, "-m", "services.cli.main", "up", "--port", "0", "--data", str(tmp_path / "data")],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert second.returncode == 1
        assert "another server runs on" in second.stderr
        port = service.address.rsplit(":", 1)[1]
        third = subprocess.run(
            [sys.executable, "-m", "services.cli.main", "up", "--port", port, "--data", str(tmp_path / "other")],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert third.returncode == 1
        assert "--port: cannot listen" in third.stderr
        assert httpx.get(f"{service.address}/readyz").status_code == 200
        assert httpx.get(f"{service.address}/readyz", headers={"Host": "evil.example"}).status_code == 400


def test_scans_from_submit_to_download(call: Call, spec: Path, tmp_path: Path) -> None:
    with running_service(tmp_path / "data", tmp_path / "log") as service:
        at = ("--url", service.address)
        scan = call("scans", "submit", spec, *at).stdout.strip()
        watched = call("scans", "watch", scan, *at)
        assert watched.exit_code == 0, watched.output
        assert "succeeded" in watched.stdout
        assert json.loads(call("scans", "show", scan, "--json", *at).stdout)["status"] == "succeeded"
        assert scan in call("scans", "list", "--status", "succeeded", *at).stdout
        assert json.loads(call("scans", "list", "--status", "failed", "--json", *at).stdout) == []
        assert "2.170" in call("scans", "modes", scan, *at).stdout
        got = json.loads(call("scans", "download", scan, "--all", "--out", "got", "--json", *at).stdout)
        assert {"modes.json", "truth.npz", "frames/frame_0002.zip"} <= {
            name.replace(".bin", ".zip") for name in got["files"]
        }
        refused = call("scans", "cancel", scan, *at)
        assert (refused.exit_code, "cannot become" in refused.stderr) == (1, True)
        retried = json.loads(call("scans", "retry", scan, "--from", "scan.identify", "--json", *at).stdout)
        assert retried["generation"] == 1
        assert call("scans", "show", "nobody", *at).exit_code == 1
        assert call("scans", "list", "--status", "done", *at).exit_code == 3
    assert call("scans", "list", "--url", "http://127.0.0.1:9").exit_code == 1
