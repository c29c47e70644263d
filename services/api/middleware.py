"""Around every request: an id, headers that keep browsers careful, and a limit on what is read into memory."""

import re
import uuid

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HIGHEST_BODY_BYTES = 4 << 20
REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
CAREFUL = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
NOTHING_LOADED = "default-src 'none'; frame-ancestors 'none'"
"""For what is no page; pages say for themselves what they load."""


class RequestIds:
    """Gives every request an id (the caller's own, if it is harmless) and answers with it."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        given = Headers(scope=scope).get("x-request-id", "")
        request_id = given if REQUEST_ID.fullmatch(given) else str(uuid.uuid4())
        scope.setdefault("state", {})["request_id"] = request_id

        async def send_with_id(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["X-Request-Id"] = request_id
                for key, value in CAREFUL.items():
                    headers.setdefault(key, value)
                if scope["path"].startswith("/v1"):
                    headers.setdefault("Content-Security-Policy", NOTHING_LOADED)
                    headers.setdefault("Cache-Control", "no-store")
                if scope["scheme"] == "https":
                    headers.setdefault("Strict-Transport-Security", "max-age=31536000")
            await send(message)

        await self.app(scope, receive, send_with_id)


class BodyLimit:
    """Refuses a body above `HIGHEST_BODY_BYTES`, announced or not, before it is in memory; files pass by it."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or _is_file(scope):
            await self.app(scope, receive, send)
            return
        body = b""
        more = True
        while more:
            message = await receive()
            body += message.get("body", b"")
            more = message.get("more_body", False)
            if len(body) > HIGHEST_BODY_BYTES or _announced(scope) > HIGHEST_BODY_BYTES:
                await _too_large(scope)(scope, receive, send)
                return
        await self.app(scope, _replay(body, receive), send)


def _is_file(scope: Scope) -> bool:
    """Whether the body is a file, which its route writes to disk as it comes and limits by itself."""
    path = scope["path"].rstrip("/")
    if path == "/v1/uploads" or path == "/v1/captures/archive":
        return bool(scope["method"] == "POST")
    return bool(scope["method"] == "PATCH" and path.startswith("/v1/uploads/"))


def _announced(scope: Scope) -> int:
    length = Headers(scope=scope).get("content-length", "")
    return int(length) if length.isascii() and length.isdigit() else 0


def _replay(body: bytes, receive: Receive) -> Receive:
    """A `receive` that gives the body read already, then whatever comes after it."""
    pending: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def replayed() -> Message:
        return pending.pop() if pending else await receive()

    return replayed


def _too_large(scope: Scope) -> JSONResponse:
    body = {
        "type": "urn:nerfmodal:problem:body-too-large",
        "title": "Content Too Large",
        "status": 413,
        "detail": f"The body is larger than {HIGHEST_BODY_BYTES} bytes.",
        "instance": scope["path"],
        "code": "BODY_TOO_LARGE",
        "pointer": None,
        "hint": "A specification is small: name files by their path.",
        "request_id": scope["state"]["request_id"],
    }
    return JSONResponse(body, status_code=413, media_type="application/problem+json", headers={"Connection": "close"})
