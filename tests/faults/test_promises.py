"""Promises that no single fault shows: (a) what was answered with 2xx is there, (j) nobody waits behind a flood."""

import os
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from scanjobs.settings import Settings

from tests.faults.redis_faults import body
from tests.faults.steps import assert_whole, kill, seconds_since
from tests.integration.toy_service import TOYS, serving, toy_spec
from tests.stack.servers import free_port

SERVER_S = 30.0


def test_what_was_answered_with_2xx_outlives_the_server(embedded: Settings) -> None:
    """Promise (a): the whole server is killed in the moment of its answer; the next one runs the scan.

    Guard: the handler commits before it answers (`scans._store`).
    Seen to fail: with the write put into a thread that begins half a second later, the scan is not there.
    """
    port = free_port()
    server = start_server(embedded.data_folder, port)
    try:
        await_server(port)
        answer = httpx.post(f"http://127.0.0.1:{port}/v1/scans", json=body(0))
    finally:
        kill(server.pid)
        server.wait()
    assert answer.status_code == 202
    with serving(embedded) as service:
        assert_whole(service, answer.json()["id"])


def test_small_scan_starts_behind_a_flood(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Promise (j): ten scans of forty frames wait; the scan of one frame that comes last begins within a step + 10 s.

    Guard: the dispatcher's turns (`dispatch._turn`) and its small window.
    Seen to fail: with the turn decided by age alone (`_turn` returning the step's id) it waits for hundreds of steps.
    """
    monkeypatch.setenv("TOY_SECONDS", "0.2")
    with serving(settings) as service:
        for seed in range(10):
            service.submit(toy_spec(frames=40, seed=seed))
        service.wait(lambda: len(service.runners()) == 2)
        began = time.monotonic()
        small = service.submit(toy_spec(frames=1, seed=99))
        service.wait(lambda: service.scan(small).state != "queued")
        assert seconds_since(began) < 0.2 + 10
        assert service.end_of(small, 30).state == "succeeded"
        assert service.violations() == ()


def start_server(data_folder: Path, port: int) -> "subprocess.Popen[bytes]":
    """`nerfmodal up` with toys."""
    command = [sys.executable, "-m", "services.cli.main", "up", "--port", str(port), "--data", str(data_folder)]
    return subprocess.Popen(command, env={**os.environ, "NERFMODAL_TASKS": TOYS}, start_new_session=True)


def await_server(port: int) -> None:
    """Until it answers."""
    deadline = time.monotonic() + SERVER_S
    while time.monotonic() < deadline:
        try:
            if httpx.get(f"http://127.0.0.1:{port}/healthz").is_success:
                return
        except httpx.TransportError:
            time.sleep(0.1)
    raise TimeoutError(f"the server does not answer (it was given {SERVER_S} s)")
