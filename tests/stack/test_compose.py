"""The commands of docker-compose.yml, run as it gives them, with servers of the test's own in the place of its own.

Host names, paths and ports are replaced; everything else of the environment and every argument is as in the file.
"""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.stack.object_store import ObjectServer
from tests.stack.servers import Redis, free_port

ROOT = Path(__file__).parents[2]
COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
START_S = 60.0
PROGRAMS = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
WORKERS = ("worker-render", "worker-train", "worker-identify")


def command_of(name: str) -> list[str]:
    """What the container runs: the file's command, or its image's."""
    service = COMPOSE[name]
    if "command" in service:
        return list(service["command"])
    dockerfile = (ROOT / service["build"]["dockerfile"]).read_text()
    found = re.search(r"^CMD (\[.*\])$", dockerfile, flags=re.MULTILINE)
    assert found is not None
    return list(json.loads(found[1]))


@contextmanager
def container(name: str, environment: Mapping[str, str], port: int | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """Its main process, killed if it still lives when the block ends."""
    command = [str(port) if port and part == "8000" else part for part in command_of(name)]
    variables = {**os.environ, **environment, "PATH": PROGRAMS}
    process = subprocess.Popen(command, cwd=ROOT, env=variables, start_new_session=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def answer(url: str, *, body: bytes | None = None) -> tuple[int, bytes]:
    """Wait for a 2xx, as the container's health check does."""
    deadline = time.monotonic() + START_S
    while True:
        try:
            asked = urllib.request.Request(url, data=body, headers={"Content-Type": "application/json"})
            with urllib.request.urlopen(asked, timeout=5) as got:
                return got.status, got.read()
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


@pytest.fixture
def objects(tmp_path: Path) -> Iterator[ObjectServer]:
    """An object store with the bucket that the file's `bucket` makes."""
    server = ObjectServer(tmp_path)
    bucket = COMPOSE["bucket"]["entrypoint"][-1].rpartition("/")[2]
    urllib.request.urlopen(urllib.request.Request(f"{server.endpoint}/{bucket}", method="PUT")).close()
    yield server
    server.stop()


@pytest.fixture
def environment(tmp_path: Path, database_url: str, redis: Redis, objects: ObjectServer) -> dict[str, str]:
    """The workers' environment of the file, on this machine."""
    given = {key: str(value) for key, value in COMPOSE["worker-train"]["environment"].items()}
    here = {
        "NERFMODAL_DATABASE_URL": database_url,
        "NERFMODAL_BROKER_URL": redis.url,
        "NERFMODAL_DATA_FOLDER": str(tmp_path / "data"),
        "NERFMODAL_CAPTURE_ROOTS": str(tmp_path),
        "AWS_ENDPOINT_URL": objects.endpoint,
        "AWS_SECRET_ACCESS_KEY": "secret-of-the-test",
    }
    assert set(here) <= set(given)
    return given | here


def test_commands_start_answer_and_stop(environment: dict[str, str]) -> None:
    """Migrate ends with 0; the API and every kind of worker become ready, know each other, and end in good order."""
    migrate = subprocess.run(
        command_of("migrate"),
        cwd=ROOT,
        env={**os.environ, **environment, "PATH": PROGRAMS},
        check=False,
    )
    assert migrate.returncode == 0
    port, metrics = free_port(), {name: free_port() for name in WORKERS}
    keyless = {**environment, "NERFMODAL_KEYLESS": "true"}
    with ExitStack() as running:
        processes = [running.enter_context(container("api", keyless, port))]
        for name in WORKERS:
            own = {**environment, "NERFMODAL_METRICS_PORT": str(metrics[name])}
            processes.append(running.enter_context(container(name, own)))
        assert json.loads(answer(f"http://127.0.0.1:{port}/readyz")[1])["status"] == "ok"
        for number in metrics.values():
            assert answer(f"http://127.0.0.1:{number}/readyz")[0] == 200
        workers = wait_for_workers(port, len(WORKERS))
        served = {queue for worker in workers for queue in worker["queues"]}
        asked = {queue for name in WORKERS for queue in command_of(name)[-1].split(",")}
        assert served == asked
        text = answer(f"http://127.0.0.1:{metrics['worker-render']}/metrics")[1].decode()
        assert f"nerfmodal_workers {len(WORKERS)}.0" in text
        for process in processes:
            process.terminate()  # as `docker stop` does
        api, *others = [process.wait(20) for process in processes]
    assert api in (0, -signal.SIGTERM)  # uvicorn ends in good order, then by the signal that it was sent
    assert others == [0] * len(WORKERS)
    assert shlex.join(command_of("worker-render")) == "nerfmodal worker --queues render"


def wait_for_workers(port: int, count: int) -> list[dict[str, Any]]:
    deadline = time.monotonic() + START_S
    while True:
        workers: list[dict[str, Any]] = json.loads(answer(f"http://127.0.0.1:{port}/v1/info")[1])["workers"]
        if len(workers) == count or time.monotonic() > deadline:
            return workers
        time.sleep(0.2)
