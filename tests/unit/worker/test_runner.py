"""The runner as a process: what it says on its pipe, what it keeps off it, and when it ends."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scanjobs.messages import RENDER

from services.worker.protocol import TASKS_VARIABLE, Order, encode, run_line
from tests.integration.toy_service import toy_spec

Process = subprocess.Popen[bytes]


@pytest.fixture
def runner() -> Iterator[Process]:
    """A runner of toys."""
    environment = {**os.environ, TASKS_VARIABLE: "tests.integration.toy_tasks", "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-m", "services.worker.runner"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    )
    with process:
        yield process
        process.kill()


def order(runner: Process, out: Path, trouble: str = "", kind: str = RENDER) -> None:
    """Order frame 0."""
    spec = toy_spec(trouble=trouble).model_dump(mode="json")
    assert runner.stdin is not None
    runner.stdin.write(encode(run_line(Order(kind=kind, frame=0, spec=spec, inputs=(), out=str(out)))))
    runner.stdin.flush()


def last_line(runner: Process) -> dict[str, Any]:
    """What it says after its progress; every line before must be progress."""
    assert runner.stdout is not None
    for text in runner.stdout:
        line: dict[str, Any] = json.loads(text)
        if "progress" not in line:
            return line
    raise EOFError


def test_steps_follow_each_other_and_prints_stay_off_the_pipe(runner: Process, tmp_path: Path) -> None:
    for _ in range(2):
        order(runner, tmp_path)
        produced = last_line(runner)["produced"]
        assert [file["role"] for file in produced["files"]] == ["frame", "truth"]
        assert produced["facts"]["pid"] == runner.pid


def test_it_ends_when_its_supervisor_closes_the_pipe(runner: Process, tmp_path: Path) -> None:
    order(runner, tmp_path, f"{RENDER}:0:slow")
    assert runner.stdout is not None
    runner.stdout.readline()
    assert runner.stdin is not None
    began = time.monotonic()
    runner.stdin.close()
    assert runner.wait(5) == 0
    assert time.monotonic() - began < 3.0


def test_stop_ends_the_step_and_the_runner_takes_the_next(runner: Process, tmp_path: Path) -> None:
    order(runner, tmp_path, f"{RENDER}:0:slow")
    assert runner.stdin is not None
    time.sleep(0.3)
    runner.stdin.write(encode({"stop": True}))
    runner.stdin.flush()
    assert last_line(runner)["failed"]["code"] == "STOPPED"
    order(runner, tmp_path)
    assert "produced" in last_line(runner)


@pytest.mark.parametrize(
    ("trouble", "code", "retryable"), [("invalid", "INVALID_INPUT", False), ("broken", "INTERNAL", True)]
)
def test_errors_are_lines(runner: Process, tmp_path: Path, trouble: str, code: str, retryable: bool) -> None:
    order(runner, tmp_path, f"{RENDER}:0:{trouble}")
    failed = last_line(runner)["failed"]
    assert (failed["code"], failed["retryable"]) == (code, retryable)
    assert failed["hint"]
