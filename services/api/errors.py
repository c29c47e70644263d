"""Every refusal as RFC 9457 problem+json with a stable `code`, the bad field's JSON pointer and the remedy.

Never 200 with an error inside. What nobody foresaw is a 500 that says nothing but its request id.
"""

import logging
import re
from collections.abc import Mapping, Sequence
from functools import cache
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from nerfmodal.errors import InvalidInput, MissingExtra, NerfmodalError
from scanjobs.errors import (
    ArtifactDamaged,
    IdempotencyConflict,
    IllegalTransition,
    InvalidCursor,
    NotFound,
    QuotaExceeded,
    ScanjobsError,
    SourceOutsideRoots,
    TooLarge,
    UploadBusy,
    UploadConflict,
)
from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException

from services.api.complaints import Complaint, complaints

MEDIA_TYPE = "application/problem+json"
STATUS_OF: Mapping[type[Exception], int] = {
    NotFound: 404,
    IllegalTransition: 409,
    IdempotencyConflict: 409,
    UploadConflict: 409,
    UploadBusy: 423,
    TooLarge: 413,
    QuotaExceeded: 507,
    InvalidCursor: 422,
    SourceOutsideRoots: 422,
    ArtifactDamaged: 500,
    InvalidInput: 422,
    MissingExtra: 501,
}
TITLE_OF: Mapping[int, str] = {460: "Checksum Mismatch"}
CODE_OF_STATUS: Mapping[int, str] = {
    401: "UNAUTHORIZED",
    403: "FORBIDDEN",
    404: "NOT_FOUND",
    405: "METHOD_NOT_ALLOWED",
    413: "BODY_TOO_LARGE",
    415: "UNSUPPORTED_MEDIA_TYPE",
    416: "RANGE_NOT_SATISFIABLE",
    429: "TOO_MANY_REQUESTS",
}
log = logging.getLogger(__name__)


class RequestRefused(Exception):
    """The API itself refuses a request: what it says and does is in the fields of the problem."""

    def __init__(
        self,
        status: int,
        code: str,
        detail: str,
        *,
        pointer: str | None = None,
        hint: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.code = code
        self.detail = detail
        self.pointer = pointer
        self.hint = hint
        self.headers = headers


def problem(
    request: Request,
    status: int,
    code: str,
    detail: str,
    *,
    pointer: str | None = None,
    hint: str | None = None,
    errors: Sequence[Complaint] = (),
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """The answer; `errors` lists every complaint where there is more than the first."""
    body: dict[str, Any] = {
        "type": f"urn:nerfmodal:problem:{code.lower().replace('_', '-')}",
        "title": TITLE_OF.get(status) or HTTPStatus(status).phrase,
        "status": status,
        "detail": detail,
        "instance": request.url.path,
        "code": code,
        "pointer": pointer,
        "hint": hint,
        "request_id": getattr(request.state, "request_id", None),
    }
    if errors:
        body["errors"] = [{"pointer": row.pointer, "detail": row.message, "hint": row.hint} for row in errors]
    return JSONResponse(body, status_code=status, media_type=MEDIA_TYPE, headers=dict(headers or {}))


def install(app: FastAPI) -> None:
    """Answer every exception that a route may raise."""
    app.add_exception_handler(RequestRefused, _on_refusal)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(ScanjobsError, _on_known)
    app.add_exception_handler(NerfmodalError, _on_known)
    app.add_exception_handler(DBAPIError, on_database)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_anything)


def _on_refusal(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestRefused)
    return problem(
        request,
        error.status,
        error.code,
        error.detail,
        pointer=error.pointer,
        hint=error.hint,
        headers=error.headers,
    )


def _on_validation(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    rows = error.errors()
    place = rows[0]["loc"][0]
    if rows[0]["type"] == "json_invalid":
        detail = f"The body is no JSON: {rows[0].get('ctx', {}).get('error', 'it cannot be parsed')}."
        return problem(request, 400, "INVALID_JSON", detail, hint="Send one JSON object.")
    about_scan = "/scans" in request.url.path or request.url.path == "/v1/preflight"
    found = complaints([{**row, "loc": row["loc"][1:]} for row in rows if row["loc"][0] == place], of_scan=about_scan)
    first = found[0]
    if place == "body":
        code = "INVALID_SPEC" if about_scan else "INVALID_BODY"
        return problem(request, 422, code, first.message, pointer=first.pointer, hint=first.hint, errors=found)
    name = first.pointer.lstrip("/")
    return problem(
        request, 422, "INVALID_PARAMETER", f"The {place} parameter '{name}' {first.message}", hint=first.hint
    )


def _on_known(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ScanjobsError | NerfmodalError)
    status = next((STATUS_OF[kind] for kind in type(error).__mro__ if kind in STATUS_OF), 500)
    if status >= 500:
        log.error("%s: %s", error.code, error)
    pointer = error.where if error.where and error.where.startswith("/") else None
    return problem(request, status, error.code, error.message, pointer=pointer, hint=error.hint)


def on_database(request: Request, error: Exception) -> JSONResponse:
    """The database did not answer: nothing was stored, the same request may be sent again."""
    log.error("the database refused: %s", error)
    return problem(
        request,
        503,
        "DATABASE_UNAVAILABLE",
        "The database did not take the request; nothing was stored.",
        hint="Send it again with the same Idempotency-Key.",
        headers={"Retry-After": "2"},
    )


def _on_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    code = CODE_OF_STATUS.get(error.status_code, f"HTTP_{error.status_code}")
    headers = dict(error.headers or {})
    if error.status_code == 405:
        headers["Allow"] = ", ".join(_methods_at(request))
    return problem(request, error.status_code, code, str(error.detail), headers=headers)


def _methods_at(request: Request) -> list[str]:
    """Every method that the path takes; the router names those of one route alone."""
    paths: dict[str, dict[str, Any]] = request.app.openapi()["paths"]
    here = request.url.path
    fit = [paths[here]] if here in paths else [paths[path] for path in paths if _regex_of(path).fullmatch(here)]
    return sorted({method.upper() for methods in fit for method in methods})


@cache
def _regex_of(path: str) -> re.Pattern[str]:
    """What a path of the OpenAPI document stands for; a file's name may have slashes."""
    parts = re.split(r"(\{\w+\})", path)
    return re.compile(
        "".join(("(?s:.+)" if part == "{name}" else "[^/]+") if part[:1] == "{" else re.escape(part) for part in parts)
    )


def _on_anything(request: Request, error: Exception) -> JSONResponse:
    log.error("unforeseen, request %s", getattr(request.state, "request_id", None), exc_info=error)
    return problem(
        request, 500, "INTERNAL", "The service failed in a way nobody foresaw.", hint="Quote the request_id."
    )
