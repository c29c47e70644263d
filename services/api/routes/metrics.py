"""`/metrics` for Prometheus, and the ear that hears every request: how long it took, one line of the log about it.

The route's template is the label, never the path: ids would make a series each. Aggregates over all owners, so keep it
behind the front door (see docs/howto/monitor.md).
"""

import logging
import time
from typing import Final

from fastapi import APIRouter, FastAPI, Request, Response
from scanjobs.logs import about
from scanjobs.telemetry import Telemetry
from scanjobs.tracing import HEADER, NO_TRACING, Tracing, open_tracing
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

router = APIRouter(tags=["health"])
log = logging.getLogger("nerfmodal.access")
QUIET: Final = frozenset({"/healthz", "/readyz", "/metrics"})
"""Asked every few seconds by machines."""
NO_ROUTE: Final = "none"


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def metrics(request: Request) -> Response:
    """Totals and gauges in Prometheus' text format."""
    telemetry = request.app.state.telemetry
    assert isinstance(telemetry, Telemetry)
    text, content_type = telemetry.exposition(request.headers.get("accept", ""))
    return Response(text, media_type=content_type)


def install(app: FastAPI) -> None:
    """Give the app its instruments; call it after every other middleware is added, so that it hears them too."""
    parts = app.state.parts
    app.state.telemetry = Telemetry(parts.settings, parts.store)
    app.add_middleware(Ear, telemetry=app.state.telemetry, tracing=open_tracing(parts.settings, "nerfmodal-api"))


class Ear:
    """Times and logs every request. Pure ASGI: it costs microseconds and hears streamed answers to their end."""

    def __init__(self, app: ASGIApp, telemetry: Telemetry, tracing: Tracing = NO_TRACING) -> None:
        self.app = app
        self._telemetry = telemetry
        self._tracing = tracing

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began, status = time.perf_counter(), 500

        async def send_and_look(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        name, parent = f"{scope['method']} {scope['path']}", Headers(scope=scope).get(HEADER)
        traced = self._tracing if scope["path"] not in QUIET else NO_TRACING
        try:
            with traced.span(name, parent, {"http.request.method": scope["method"]}):
                await self.app(scope, receive, send_and_look)
        finally:
            self._note(scope, status, time.perf_counter() - began)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = template_of(scope)
        method = scope["method"] if route != NO_ROUTE else "any"
        self._telemetry.http.labels(method, route, str(status)).observe(seconds)
        level = logging.DEBUG if route in QUIET else logging.INFO
        with about(request_id=scope.get("state", {}).get("request_id", "")):
            said = {"method": scope["method"], "route": route, "status": status, "duration_s": round(seconds, 4)}
            log.log(level, "request", extra=said)


def template_of(scope: Scope) -> str:
    """`/v1/scans/{scan_id}` for every scan; `none` where nothing matched."""
    return str(getattr(scope.get("route"), "path", NO_ROUTE))
