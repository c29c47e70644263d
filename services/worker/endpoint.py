"""What a worker answers over HTTP when `metrics_port` is set: /metrics, /healthz and /readyz, to probes and Prometheus.

`/healthz` says whether the worker still ticks, well or not: a database that is away is no reason to kill a worker,
which waits for it by itself. `/readyz` looks at what steps need.
"""

import json
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final

from scanjobs import health
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.telemetry import Telemetry

JSON: Final = "application/json"
Answer = tuple[int, str, bytes]
"""Status, content type, body."""


class Endpoint:
    """A listening port with one thread; `start`, then `stop`, once each."""

    def __init__(
        self, *, settings: Settings, store: Store, telemetry: Telemetry, seconds_since_tick: Callable[[], float]
    ) -> None:
        self._settings = settings
        self._store = store
        self._telemetry = telemetry
        self._seconds_since_tick = seconds_since_tick
        self._server = ThreadingHTTPServer(("", settings.metrics_port), _handler(self.answer))
        self._thread = threading.Thread(target=self._server.serve_forever, name="endpoint", daemon=True)

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._server.server_port

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def stop(self) -> None:
        """Answer no more."""
        self._server.shutdown()
        self.close()

    def close(self) -> None:
        """Let go of the port, where it has not been started."""
        self._server.server_close()

    def answer(self, path: str, accept: str) -> Answer:
        """What a path is answered with."""
        if path == "/metrics":
            text, content_type = self._telemetry.exposition(accept)
            return 200, content_type, text
        if path == "/healthz":
            return self._alive()
        if path == "/readyz":
            return self._ready()
        return 404, JSON, b'{"status": "no such path"}'

    def _alive(self) -> Answer:
        silent_s = self._seconds_since_tick()
        status = "ok" if silent_s <= self._settings.lease_s else "unavailable"
        body = {"status": status, "seconds_since_tick": round(silent_s, 1)}
        return 200 if status == "ok" else 503, JSON, json.dumps(body).encode()

    def _ready(self) -> Answer:
        found = health.look(self._settings, self._store, health.NEEDED_BY_WORKER)
        body = {"status": found.status, "checks": dict(found.checks)}
        return 503 if found.status == "unavailable" else 200, JSON, json.dumps(body).encode()


def _handler(answer: Callable[[str, str], Answer]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:  # the name that http.server looks for
            status, content_type, body = answer(self.path.partition("?")[0], self.headers.get("Accept", ""))
            self.send_response(status)
            self.send_header("Content-Type", content_type)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            """Probes come every few seconds; the log is for what happens."""

    return Handler
