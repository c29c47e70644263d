"""The API in a process of its own, which a test may kill and start again on the same port."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx

from tests.unit.api.service import Service

ROOT = Path(__file__).parents[2]
START_S = 30.0


class Api:
    """The API in a process of its own, on one port, to be killed."""

    def __init__(self, service: Service) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self._environment = os.environ | {
            "NERFMODAL_DATA_FOLDER": str(service.settings.data_folder),
            "NERFMODAL_KEYLESS": "true",
            "NERFMODAL_LOG_LEVEL": "warning",
            "PYTHONPATH": f"{ROOT}:{ROOT / 'libs'}",
        }
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Begin, and wait until it answers."""
        command = [sys.executable, "-m", "uvicorn", "--factory", "services.api.main:app", "--port", str(self.port)]
        self._process = subprocess.Popen(
            [*command, "--log-level", "error"], cwd=ROOT, env=self._environment, start_new_session=True
        )
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            try:
                httpx.get(f"{self.url}/healthz", timeout=1)
            except httpx.HTTPError:
                time.sleep(0.1)
            else:
                return
        raise AssertionError("the API does not answer")

    @property
    def pid(self) -> int:
        """Of the process that answers."""
        assert self._process is not None
        return self._process.pid

    def kill(self) -> None:
        """As a crash does."""
        if self._process is not None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._process = None
