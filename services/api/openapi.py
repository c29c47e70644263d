"""The OpenAPI document: what FastAPI writes, with every refusal as the problem+json that is really sent."""

from collections.abc import Iterator, Mapping
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from services.api.doorkeeper import is_guarded
from services.api.errors import MEDIA_TYPE
from services.api.schemas import Problem

Document = dict[str, Any]
REFERENCE = "#/components/schemas/{model}"
SCHEME = "key"
TUS = "Tus-Resumable"
NAMING_A_PLANT = ("/v1/tracks", "/v1/environment", "/v1/schedules")
"""A plant that is not there is refused with 404 here too."""
KEYS = "An API key, `nm_…`; none is needed on the machine that `nerfmodal up` runs on."
MEANING: Mapping[int, str] = {
    400: "The body is no JSON.",
    401: "No API key, or one that is unknown, revoked or expired.",
    403: "The API key lacks the scope that this needs.",
    404: "There is no such thing for this caller.",
    409: "The scan's state does not allow it, or the Idempotency-Key came with another body before.",
    413: "The body is too large.",
    412: "The client speaks another version of tus.",
    415: "The Content-Type is not the one that this needs.",
    416: "The range lies behind the end of the file.",
    422: "What is wrong, where, and what to change.",
    423: "Another request is sending to the same upload.",
    429: "Too many requests with this key; `Retry-After` says when to go on.",
    460: "The bytes do not have their checksum; nothing of them is kept.",
    503: "The database does not answer; nothing was stored. Send it again.",
    507: "There is no room for it: the owner's quota or the disk.",
}


def document_refusals(app: FastAPI) -> None:
    """Let the app describe every refusal of every operation."""

    def document() -> Document:
        if app.openapi_schema is None:
            app.openapi_schema = _described(app)
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]


def _described(app: FastAPI) -> Document:
    document = get_openapi(
        title=app.title, version=app.version, description=app.description, routes=app.routes, openapi_version="3.1.0"
    )
    schemas = document["components"]["schemas"]
    schema = Problem.model_json_schema(ref_template=REFERENCE)
    schemas |= schema.pop("$defs", {})
    schemas["Problem"] = schema
    document["components"]["securitySchemes"] = {SCHEME: {"type": "http", "scheme": "bearer", "description": KEYS}}
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    for path, method, operation in _operations(document):
        for parameter in operation.get("parameters", ()):
            if parameter["name"] == TUS:  # its absence is answered with 412, not with the 422 of other parameters
                parameter |= {"required": True, "schema": {"const": "1.0.0"}}
        if is_guarded(path):
            operation["security"] = [{SCHEME: []}]
        for content in operation.get("requestBody", {}).get("content", {}).values():
            schemas |= content["schema"].pop("$defs", {})
        operation["responses"].pop("422", None)
        operation["responses"] |= {str(status): _problem(status) for status in _refusals(path, method, operation)}
    return document


def _operations(document: Document) -> Iterator[tuple[str, str, Document]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield path, method, operation


def _refusals(path: str, method: str, operation: Document) -> list[int]:
    """The statuses that an operation may refuse with; health checks have their own answer for 503."""
    found = [401, 403, 429, 503] if is_guarded(path) else []
    if "{" in path or path in NAMING_A_PLANT:
        found.append(404)
    if path.endswith("/environment") and method == "post":
        found.append(415)
    if method in ("post", "delete", "patch"):
        found.append(409)
    if "requestBody" in operation:
        found += [400, 413]
    if path.startswith(("/v1/uploads", "/v1/captures")) and method in ("post", "patch"):
        found += [400, 413, 415, 423, 507]
    if path.startswith("/v1/uploads") and method in ("post", "patch", "head", "delete"):
        found.append(412)
    if path.startswith("/v1/uploads") and method in ("post", "patch"):
        found.append(460)
    if operation.get("parameters") or "requestBody" in operation:
        found.append(422)
    if path.endswith("/artifacts/{name}"):
        found.append(416)
    return sorted(set(found))


def _problem(status: int) -> Document:
    return {
        "description": MEANING[status],
        "content": {MEDIA_TYPE: {"schema": {"$ref": REFERENCE.format(model="Problem")}}},
    }
