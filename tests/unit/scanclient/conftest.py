"""A scripted HTTP server per test, and retries without waiting."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
import stamina
from stamina.instrumentation import get_on_retry_hooks, set_on_retry_hooks

from tests.unit.scanclient.scripted import Heard, ScriptedServer


@pytest.fixture
def server() -> Iterator[ScriptedServer]:
    scripted = ScriptedServer()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def _answer(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            heard = Heard(self.command, self.path, dict(self.headers), body)
            scripted.heard.append(heard)
            reply = scripted.script(heard)
            if reply.hang_up:
                self.close_connection = True
                return
            self.send_response(reply.status)
            for key, value in reply.headers.items():
                self.send_header(key, value)
            self.send_header("Content-Length", str(len(reply.body)))
            self.end_headers()
            self.wfile.write(reply.body[: len(reply.body) - reply.cut])
            self.close_connection = reply.cut > 0

        do_GET = do_POST = _answer

        def log_message(self, *_: Any) -> None:
            pass

    http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    http.daemon_threads = True
    thread = threading.Thread(target=http.serve_forever, args=(0.01,))
    thread.start()
    scripted.address = f"http://127.0.0.1:{http.server_address[1]}"
    yield scripted
    http.shutdown()
    thread.join()
    http.server_close()


@pytest.fixture(autouse=True)
def _no_waiting() -> Iterator[None]:
    """Retry at once; the number of attempts stays the client's own."""
    hooks = get_on_retry_hooks()
    set_on_retry_hooks([])
    stamina.set_testing(True, attempts=6, cap=True)
    yield
    stamina.set_testing(False)
    set_on_retry_hooks(hooks)
