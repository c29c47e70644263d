"""A scan's steps, and what they wrote."""

from typing import Annotated

from fastapi import APIRouter, Query
from scanjobs.log_lines import read_lines
from scanjobs.repository import get_scan
from scanjobs.states import StepState
from scanjobs.step_pages import StepPlace, page_of_steps, place_of
from scanjobs.step_times import times_of

from services.api.dependencies import Owner, ScanId, TheParts, uuid_of
from services.api.schemas import StepDetail
from services.api.schemas_steps import LogPage, LogText, StepPage

HIGHEST_LIMIT = 1000
Kind = Annotated[str | None, Query(alias="step", min_length=1, max_length=32, pattern=r"^[a-z.]+$")]
router = APIRouter(prefix="/v1/scans/{scan_id}", tags=["steps"])


@router.get("/steps")
def list_(
    scan_id: ScanId,
    parts: TheParts,
    owner: Owner,
    kind: Kind = None,
    state: Annotated[list[StepState] | None, Query()] = None,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=HIGHEST_LIMIT)] = 500,
) -> StepPage:
    """Steps of the present generation, in the order they may run; several `state` are joined by or."""
    name = f"steps of {scan_id}"
    after = StepPlace(*parts.cursors.read(cursor, owner=owner, list_name=name)) if cursor else None
    with parts.store.read() as session:
        scan = get_scan(session, scan_id, owner=owner)
        rows = page_of_steps(session, scan, after=after, kind=kind, states=state or (), limit=limit + 1)
        times = times_of(session, scan, rows[:limit])
    more = parts.cursors.write(place_of(rows[limit - 1]), owner=owner, list_name=name) if len(rows) > limit else None
    return StepPage(items=[StepDetail.of(row, times[row.id]) for row in rows[:limit]], next_cursor=more)


@router.get("/logs")
def logs(
    scan_id: ScanId,
    parts: TheParts,
    owner: Owner,
    after: Annotated[int, Query(ge=0, le=1 << 62, description="`after` of the last answer.")] = 0,
    step: Annotated[str | None, Query(max_length=36, description="Id of a step, for its lines alone.")] = None,
    limit: Annotated[int, Query(ge=1, le=HIGHEST_LIMIT)] = 500,
) -> LogPage:
    """What the steps wrote, oldest first; ask again with the `after` of the answer for what has come since."""
    which = uuid_of(step, "step", f"GET /v1/scans/{scan_id}/steps") if step else None
    with parts.store.read() as session:
        scan = get_scan(session, scan_id, owner=owner)
        lines = read_lines(session, scan, after=after, step_id=which, limit=limit)
    return LogPage(items=[LogText.of(line) for line in lines], after=lines[-1].id if lines else after)
