"""Forks: a scan of its own that takes over every result that stays the same, and a scan that is forgotten."""

import hashlib
from typing import Annotated, Any

from fastapi import APIRouter, Body, Response
from fastapi.exceptions import RequestValidationError
from nerfmodal.spec import ScanSpec
from pydantic import ValidationError
from scanjobs.control import delete_scan
from scanjobs.intake import Idempotency
from scanjobs.repository import get_scan

from services.api.dependencies import ScanId, Submitter, TheParts
from services.api.routes.scans import LOOK_AGAIN_S, Key, located, look, storable, store_scan
from services.api.schemas import ScanDetail

Changes = Annotated[
    dict[str, Any],
    Body(
        description="What is to be another way, as a JSON merge patch (RFC 7396) of the scan's specification.",
        examples=[{"identification": {"max_modes": 4}}],
    ),
]
router = APIRouter(prefix="/v1/scans/{scan_id}", tags=["scans"])


@router.post("/fork", status_code=202)
def fork(
    scan_id: ScanId, changes: Changes, parts: TheParts, owner: Submitter, response: Response, key: Key = None
) -> ScanDetail:
    """Submit the scan again with changes; what they do not touch is taken over, not computed."""
    with parts.store.read() as session:
        parent = get_scan(session, scan_id, owner=owner)
    spec = changed(parent.spec, changes)
    _, digest = storable(spec)
    digest = hashlib.sha256(f"fork {scan_id} {digest}".encode()).hexdigest()
    idempotency = Idempotency(key, digest) if key else None
    submission = store_scan(parts, located(parts, spec, owner), owner, idempotency, fork_of=parent)
    response.headers["Location"] = f"/v1/scans/{submission.scan.id}"
    response.headers["Retry-After"] = LOOK_AGAIN_S
    return look(parts.store, submission.scan.id, owner)


@router.delete("", status_code=204)
def delete(scan_id: ScanId, parts: TheParts, owner: Submitter) -> None:
    """Forget a scan that has ended, with its files; forks keep theirs. 409 while it runs."""
    parts.store.write(lambda session: delete_scan(session, scan_id, owner=owner))


def changed(spec: dict[str, Any], changes: dict[str, Any]) -> ScanSpec:
    """The specification with a merge patch applied. Raises `RequestValidationError`."""
    try:
        return ScanSpec.model_validate(merged(spec, changes))
    except ValidationError as error:
        rows = error.errors(include_url=False, include_input=False)
        raise RequestValidationError([{**row, "loc": ("body", *row["loc"])} for row in rows]) from error


def merged(target: Any, patch: Any) -> Any:
    """RFC 7396: objects are merged key by key, null removes a key, everything else replaces."""
    if not isinstance(patch, dict):
        return patch
    result = dict(target) if isinstance(target, dict) else {}
    for key, value in patch.items():
        if value is None:
            result.pop(key, None)
        else:
            result[key] = merged(result.get(key), value)
    return result
