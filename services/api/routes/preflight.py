"""What a scan can and cannot find, and what it will cost, before it is submitted."""

from typing import Annotated

from fastapi import APIRouter, Query
from nerfmodal.preflight import ExpectedMode, Pace, PastStep, Preflight, Seen, pace_of, preflight, units_of, variant_of
from nerfmodal.preflight.expected import seen_in
from nerfmodal.spec import ScanSpec, SimulationSource
from pydantic import ValidationError
from scanjobs.history import PastKind, past_kinds
from scanjobs.rigs import find_certificate
from scanjobs.workers import active_workers
from sqlalchemy.orm import Session

from services.api.dependencies import Owner, TheParts
from services.api.errors import RequestRefused
from services.api.routes.scans import storable

Modes = Annotated[
    list[Annotated[str, Query(max_length=64)]] | None,
    Query(max_length=64, description="A mode that is expected, as HZ:DAMPING:MM, such as 4.8:0.01:12."),
]
Noise = Annotated[
    float | None,
    Query(ge=1e-6, le=1e6, allow_inf_nan=False, description="Standard deviation of a fitted surface in a frame, mm."),
]
router = APIRouter(prefix="/v1/preflight", tags=["preflight"])


@router.post("")
def look_ahead(spec: ScanSpec, parts: TheParts, owner: Owner, mode: Modes = None, noise_mm: Noise = None) -> Preflight:
    """What the record of this specification can resolve, and its time on these workers. Nothing is stored or opened.

    The verdict is that of the gravest finding; `refuse` means that the scan cannot answer what it is asked.
    """
    storable(spec)
    with parts.store.read() as session:
        pace = measured_pace(session, parts.settings.slots)
        certificate = spec.rig_certificate and find_certificate(session, spec.rig_certificate, owner=owner)
    return preflight(
        spec,
        expected=[_expected(text) for text in mode or ()],
        noise=None if noise_mm is None else noise_mm / 1000,
        noise_per_grain=certificate.document.get("noise_per_grain") if certificate else None,
        pace=pace,
    )


def measured_pace(session: Session, default_slots: int) -> Pace:
    """How fast the workers of this service were, and how many steps they compute at the same time."""
    slots = sum(worker.slots for worker in active_workers(session)) or default_slots
    return pace_of((past for row in past_kinds(session) if (past := _past(row)) is not None), slots)


def _past(row: PastKind) -> PastStep | None:
    """None of a specification that this version no longer reads."""
    try:
        spec = ScanSpec.model_validate(row.spec)
    except ValidationError:
        return None
    seen = seen_in(spec) or Seen(frames=row.frames, frame_rate=1.0)
    rig = spec.source.rig if isinstance(spec.source, SimulationSource) else None
    pixels = 0 if rig is None else rig.cameras * rig.width_px * rig.height_px
    return PastStep(
        step=row.step,
        variant=variant_of(row.step, spec),
        seconds=row.seconds,
        units=units_of(row.step, spec, seen, pixels),
    )


def _expected(text: str) -> ExpectedMode:
    try:
        return ExpectedMode.parse(text)
    except ValueError as error:
        raise RequestRefused(422, "INVALID_PARAMETER", f"The query parameter 'mode' {error}") from error
