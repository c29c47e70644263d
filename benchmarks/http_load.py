"""A small HTTP/1.1 client that costs little beside the server it loads, and that server as a process.

Requests are bytes made once; an answer is read to its end and its status looked at. Keep-alive, one connection per
client.
"""

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from tests.stack.servers import free_port

START_S = 30.0
MakeRequest = Callable[[], bytes]


@contextmanager
def serving(variables: Mapping[str, str]) -> Iterator[int]:
    """`benchmarks.load_app` in a process of its own while the block runs; its port."""
    port = free_port()
    command = [sys.executable, "-m", "uvicorn", "--factory", "benchmarks.load_app:app", "--port", str(port)]
    command += ["--log-level", "warning", "--no-access-log"]
    process = subprocess.Popen(command, env={**os.environ, **variables})
    try:
        _wait(port, process)
        yield port
    finally:
        process.terminate()
        process.wait(15)


def request(method: str, path: str, body: bytes = b"") -> bytes:
    """A request as it goes over the wire."""
    head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body


def throughput(port: int, make: MakeRequest, *, clients: int, seconds: float) -> float:
    """Answers per second that so many clients get who ask again at once."""
    return asyncio.run(_many(port, make, clients, seconds))


def latencies(port: int, wire: bytes, count: int) -> list[float]:
    """Seconds that one client waits, request by request."""
    return asyncio.run(_one_by_one(port, wire, count))


async def _many(port: int, make: MakeRequest, clients: int, seconds: float) -> float:
    began = time.monotonic()
    done = await asyncio.gather(*(_client(port, make, began + seconds) for _ in range(clients)))
    return sum(done) / (time.monotonic() - began)


async def _client(port: int, make: MakeRequest, until: float) -> int:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    done = 0
    while time.monotonic() < until:
        await ask(reader, writer, make())
        done += 1
    writer.close()
    return done


async def _one_by_one(port: int, wire: bytes, count: int) -> list[float]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    taken = []
    for _ in range(count):
        began = time.perf_counter()
        await ask(reader, writer, wire)
        taken.append(time.perf_counter() - began)
    writer.close()
    return taken


async def ask(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, wire: bytes) -> bytes:
    """Send a request and return the body of its answer. Raises `RuntimeError` unless it is a 2xx."""
    writer.write(wire)
    head = await reader.readuntil(b"\r\n\r\n")
    length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n", 1)[0])
    body = await reader.readexactly(length)
    if not head.startswith(b"HTTP/1.1 2"):
        raise RuntimeError(f"{head.decode()}{body.decode()}")
    return body


def _wait(port: int, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            latencies(port, request("GET", "/healthz"), 1)
        except OSError:
            time.sleep(0.1)
        else:
            return
    raise RuntimeError("the API did not start")
