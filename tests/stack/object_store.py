"""An S3 of the test's own: moto's server, on a free port."""

import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import obstore
from obstore.store import S3Store

from tests.stack.servers import START_S, free_port

BUCKET = "scans"


class ObjectServer:
    """What it holds lies in its memory."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        with (folder / "moto.log").open("wb") as log:
            command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(self.port)]
            self._process = subprocess.Popen(command, stdout=log, stderr=log)
        self._await()
        urllib.request.urlopen(urllib.request.Request(f"{self.endpoint}/{BUCKET}", method="PUT")).close()

    @property
    def endpoint(self) -> str:
        """What `AWS_ENDPOINT_URL` is to be."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def environment(self) -> dict[str, str]:
        """What a service on this store is started with."""
        return {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
        }

    def stored(self) -> set[str]:
        """Every object in the bucket."""
        options = {"allow_http": True}
        store = S3Store(
            BUCKET,
            endpoint=self.endpoint,
            access_key_id="test",
            secret_access_key="test",
            region="us-east-1",
            client_options=options,
        )
        return {one["path"] for batch in obstore.list(store) for one in batch}

    def stop(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()

    def _await(self) -> None:
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            try:
                urllib.request.urlopen(f"{self.endpoint}/moto-api/data.json").close()
            except OSError:
                time.sleep(0.1)
            else:
                return
        raise TimeoutError("moto's server does not answer")
