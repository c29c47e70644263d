"""Before anything of a request is read: who sends it, and whether he sends too much.

Everything under ``/v1`` and ``/brapi`` needs an API key (`Authorization: Bearer nm_…`, never in the address). A service
that runs on its user's own machine (`keyless`) needs none from callers on that machine; what a proxy forwarded, and
what a page of another origin made a browser send, is no such caller.
"""

import ipaddress
import math
import time
from typing import Final
from urllib.parse import urlsplit

from scanjobs.owners import NOTED_EVERY_S, authenticate, note_use, principal_of
from scanjobs.scopes import LOCAL, Principal
from scanjobs.settings import Settings
from scanjobs.store import Store
from sqlalchemy.exc import DBAPIError
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from services.api.errors import on_database, problem
from services.api.rates import Rates

GUARDED: Final = ("/v1", "/brapi")
FORWARDED: Final = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-real-ip", "via")
FAILURES_PER_MINUTE: Final = 60
"""Wrong keys from one address; 256 bits are not guessed, this keeps the log readable."""
CHALLENGE: Final = 'Bearer realm="nerfmodal"'


class Doorkeeper:
    """Lets through who has a living key, with `state.principal` set; refuses with 401 or 429."""

    def __init__(self, app: ASGIApp, *, settings: Settings, store: Store) -> None:
        self.app = app
        self._store = store
        self._keyless = settings.keyless is not False
        self._default_rate = settings.requests_per_minute
        self._rates = Rates()
        self._failures = Rates()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not is_guarded(scope["path"]):
            await self.app(scope, receive, send)
            return
        found = await self._look(Request(scope))
        if isinstance(found, Principal):
            scope.setdefault("state", {})["principal"] = found
            await self.app(scope, receive, send)
        else:
            await found(scope, receive, send)

    async def _look(self, request: Request) -> Principal | JSONResponse:
        header = request.headers.get("authorization")
        if header is None:
            return LOCAL if self._keyless and is_local(request) else _unauthorized(request, "No API key was sent.")
        try:
            principal = await run_in_threadpool(self._principal, header)
        except DBAPIError as error:
            return on_database(request, error)
        if principal is None:
            return self._refuse(request)
        wait_s = self._rates.wait_s(principal.key_id or "", principal.requests_per_minute or self._default_rate)
        return principal if wait_s <= 0 else _too_many(request, wait_s, "requests with this key")

    def _principal(self, header: str) -> Principal | None:
        kind, _, secret = header.partition(" ")
        if kind.lower() != "bearer":
            return None
        with self._store.read() as session:
            key = authenticate(session, secret.strip())
        if key is None:
            return None
        if key.last_used_at is None or time.time() - key.last_used_at > NOTED_EVERY_S:
            self._store.write(lambda session: note_use(session, key.id))
        return principal_of(key)

    def _refuse(self, request: Request) -> JSONResponse:
        peer = request.client.host if request.client else ""
        wait_s = self._failures.wait_s(peer, FAILURES_PER_MINUTE)
        if wait_s > 0:
            return _too_many(request, wait_s, "wrong keys from this address")
        return _unauthorized(request, "The API key is unknown, revoked or expired.")


def is_guarded(path: str) -> bool:
    """Whether a path is part of the API proper; health, the documents and the page are for everybody."""
    return any(path == root or path.startswith(f"{root}/") for root in GUARDED)


def is_local(request: Request) -> bool:
    """Whether the caller is on this machine, speaks for itself, and is no page of somebody else's."""
    headers = request.headers
    if any(name in headers for name in FORWARDED) or not _is_own_origin(headers):
        return False
    return request.client is not None and _is_loopback(request.client.host)


def _is_own_origin(headers: Headers) -> bool:
    origin = headers.get("origin")
    return origin is None or urlsplit(origin).netloc == headers.get("host")


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return bool(host)  # no address at all: a caller inside this process


def _unauthorized(request: Request, detail: str) -> JSONResponse:
    hint = "Send `Authorization: Bearer nm_…`; make a key with `nerfmodal keys create`."
    return problem(request, 401, "UNAUTHORIZED", detail, hint=hint, headers={"WWW-Authenticate": CHALLENGE})


def _too_many(request: Request, wait_s: float, what: str) -> JSONResponse:
    seconds = str(math.ceil(wait_s))
    detail = f"There are too many {what}."
    hint = f"Send it again in {seconds} s."
    return problem(request, 429, "TOO_MANY_REQUESTS", detail, hint=hint, headers={"Retry-After": seconds})
