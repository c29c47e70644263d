"""A scripted HTTP server: real sockets, so that a connection can really break."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Heard:
    """One request as the server saw it."""

    method: str
    path: str
    headers: dict[str, str]
    body: bytes


@dataclass
class Reply:
    """What the server sends; `cut` bytes of the body are promised but never sent."""

    status: int = 200
    body: bytes = b"{}"
    headers: dict[str, str] = field(default_factory=dict)
    cut: int = 0
    hang_up: bool = False


def json_reply(document: Any, status: int = 200) -> Reply:
    return Reply(status=status, body=json.dumps(document).encode(), headers={"Content-Type": "application/json"})


@dataclass
class ScriptedServer:
    """Answers with `script(request)`; `heard` keeps every request."""

    address: str = ""
    heard: list[Heard] = field(default_factory=list)
    script: Callable[[Heard], Reply] = lambda _: Reply()


def scan_body(status: str = "queued", **changes: Any) -> dict[str, Any]:
    """A scan as the service writes it."""
    body: dict[str, Any] = {
        "id": "0190",
        "name": "scan",
        "status": status,
        "source": "simulation",
        "plant": None,
        "tags": ["a"],
        "generation": 1,
        "created_at": "2026-01-02T03:04:05Z",
        "started_at": None,
        "finished_at": None,
        "eta_s": None,
        "progress": [{"step": "frame.train", "done": 1, "total": 4, "running": 1, "failed": 0, "fraction": 0.3}],
        "error": None,
    }
    return body | changes
