"""Every request of the API as a value, so that a synchronous and an asynchronous client send the same ones."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote

Params = dict[str, str | list[str]]
TUS = {"Tus-Resumable": "1.0.0"}
UPLOAD_BYTES = "application/offset+octet-stream"


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """One request: what is sent, and nothing about how.

    `repeatable` says that sending it twice is the same as once, so that a broken connection may be retried.
    """

    method: str
    path: str
    params: Params = field(default_factory=dict)
    body: Any = None
    content: bytes | None = None
    headers: dict[str, str] = field(default_factory=dict)
    repeatable: bool = True

    def arguments(self) -> dict[str, Any]:
        """What `request` of an httpx client takes."""
        return {
            "method": self.method,
            "url": self.path,
            "params": self.params,
            "json": self.body,
            "content": self.content,
            "headers": self.headers,
        }


def submit(spec: dict[str, Any], idempotency_key: str) -> Call:
    """Start a scan. The key makes a repeated request harmless: the service answers with the first scan."""
    return Call(method="POST", path="/v1/scans", body=spec, headers={"Idempotency-Key": idempotency_key})


def get(scan: str) -> Call:
    return Call(method="GET", path=_path(scan))


def list_scans(*, status: str | None, plant: str | None, tag: str | None, cursor: str | None, limit: int) -> Call:
    filters = {"status": status, "plant": plant, "tag": tag, "cursor": cursor}
    params: Params = {key: value for key, value in filters.items() if value is not None}
    return Call(method="GET", path="/v1/scans", params=params | {"limit": str(limit)})


def cancel(scan: str) -> Call:
    return Call(method="POST", path=_path(scan, "cancel"))


def pause(scan: str) -> Call:
    return Call(method="POST", path=_path(scan, "pause"))


def resume(scan: str) -> Call:
    return Call(method="POST", path=_path(scan, "resume"))


def retry(scan: str, from_step: str | None, frames: Sequence[int] = ()) -> Call:
    params: Params = {"from": from_step} if from_step else {}
    if frames:
        params["frames"] = [str(frame) for frame in frames]
    return Call(method="POST", path=_path(scan, "retry"), params=params, repeatable=False)


def fork(scan: str, changes: dict[str, Any], idempotency_key: str) -> Call:
    """Submit a scan again with changes (a JSON merge patch)."""
    return Call(method="POST", path=_path(scan, "fork"), body=changes, headers={"Idempotency-Key": idempotency_key})


def delete(scan: str) -> Call:
    return Call(method="DELETE", path=_path(scan), repeatable=False)


def logs(scan: str, *, after: int, limit: int) -> Call:
    return Call(method="GET", path=_path(scan, "logs"), params={"after": str(after), "limit": str(limit)})


def list_uploads(cursor: str | None) -> Call:
    params: Params = {"limit": "200"}
    if cursor:
        params["cursor"] = cursor
    return Call(method="GET", path="/v1/uploads", params=params)


def begin_upload(name: str, length: int) -> Call:
    """A new upload; repeating it makes another one, which expires by itself."""
    metadata = "filename " + base64.b64encode(name.encode()).decode()
    headers = TUS | {"Upload-Length": str(length), "Upload-Metadata": metadata}
    return Call(method="POST", path="/v1/uploads", headers=headers)


def upload(upload_id: str) -> Call:
    return Call(method="GET", path=f"/v1/uploads/{quote(upload_id, safe='')}")


def send_bytes(upload_id: str, offset: int, content: bytes) -> Call:
    """The next bytes of an upload with their checksum; never repeated blindly: ask for the offset first."""
    checksum = "sha256 " + base64.b64encode(hashlib.sha256(content).digest()).decode()
    headers = TUS | {"Upload-Offset": str(offset), "Upload-Checksum": checksum, "Content-Type": UPLOAD_BYTES}
    path = f"/v1/uploads/{quote(upload_id, safe='')}"
    return Call(method="PATCH", path=path, content=content, headers=headers, repeatable=False)


def drop_upload(upload_id: str) -> Call:
    return Call(method="DELETE", path=f"/v1/uploads/{quote(upload_id, safe='')}", headers=TUS, repeatable=False)


def make_capture(name: str, kind: str, files: Sequence[tuple[str, str]]) -> Call:
    """A capture of uploads, given as (upload id, name in the capture)."""
    rows = [{"upload": upload_id, "name": path} for upload_id, path in files]
    body = {"name": name, "kind": kind, "files": rows}
    return Call(method="POST", path="/v1/captures", body=body, repeatable=False)


def modes(scan: str) -> Call:
    return Call(method="GET", path=_path(scan, "modes"))


def artifacts(scan: str) -> Call:
    return Call(method="GET", path=_path(scan, "artifacts"))


def artifact(scan: str, name: str, *, start: int = 0, end: int | None = None) -> Call:
    """A file's bytes from `start` on, up to but not including `end`."""
    last = "" if end is None else str(end - 1)
    ranged = start > 0 or end is not None
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-{last}"} if ranged else {})
    return Call(method="GET", path=_path(scan, "artifacts", *name.split("/")), headers=headers)


def preflight(spec: dict[str, Any], modes: Sequence[str], noise_mm: float | None) -> Call:
    """What a scan can find and will cost; nothing is started. Modes are 'HZ:DAMPING:MM'."""
    params: Params = {"mode": list(modes)} if modes else {}
    return Call(
        method="POST",
        path="/v1/preflight",
        body=spec,
        params=params if noise_mm is None else params | {"noise_mm": f"{noise_mm:g}"},
    )


def presets() -> Call:
    return Call(method="GET", path="/v1/presets")


def info() -> Call:
    return Call(method="GET", path="/v1/info")


def _path(*parts: str) -> str:
    return "/v1/scans/" + "/".join(quote(part, safe="") for part in parts)
