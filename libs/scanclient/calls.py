"""Every request of the API as a value, so that a synchronous and an asynchronous client send the same ones."""

from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """One request: what is sent, and nothing about how.

    `repeatable` says that sending it twice is the same as once, so that a broken connection may be retried.
    """

    method: str
    path: str
    params: dict[str, str] = field(default_factory=dict)
    body: Any = None
    headers: dict[str, str] = field(default_factory=dict)
    repeatable: bool = True


def submit(spec: dict[str, Any], idempotency_key: str) -> Call:
    """Start a scan. The key makes a repeated request harmless: the service answers with the first scan."""
    return Call(method="POST", path="/v1/scans", body=spec, headers={"Idempotency-Key": idempotency_key})


def get(scan: str) -> Call:
    return Call(method="GET", path=_path(scan))


def list_scans(*, status: str | None, plant: str | None, tag: str | None, cursor: str | None, limit: int) -> Call:
    filters = {"status": status, "plant": plant, "tag": tag, "cursor": cursor}
    params = {key: value for key, value in filters.items() if value is not None}
    return Call(method="GET", path="/v1/scans", params=params | {"limit": str(limit)})


def cancel(scan: str) -> Call:
    return Call(method="POST", path=_path(scan, "cancel"))


def retry(scan: str, from_step: str | None) -> Call:
    params = {"from": from_step} if from_step else {}
    return Call(method="POST", path=_path(scan, "retry"), params=params, repeatable=False)


def modes(scan: str) -> Call:
    return Call(method="GET", path=_path(scan, "modes"))


def artifacts(scan: str) -> Call:
    return Call(method="GET", path=_path(scan, "artifacts"))


def artifact(scan: str, name: str, *, start: int = 0) -> Call:
    """A file's bytes from `start` on."""
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
    return Call(method="GET", path=_path(scan, "artifacts", *name.split("/")), headers=headers)


def presets() -> Call:
    return Call(method="GET", path="/v1/presets")


def info() -> Call:
    return Call(method="GET", path="/v1/info")


def _path(*parts: str) -> str:
    return "/v1/scans/" + "/".join(quote(part, safe="") for part in parts)
