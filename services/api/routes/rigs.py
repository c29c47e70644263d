"""Rigs of cameras that were certified, and their certificates (`nerfmodal certify`)."""

from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Body, Path, Response
from nerfmodal.preflight.certified import check_certificate
from pydantic import BaseModel
from scanjobs.rigs import RigCertificate, add_certificate, list_certificates, newest_certificate

from services.api.dependencies import Owner, Submitter, TheParts

RigId = Annotated[str, Path(max_length=64, description="Digest of the cameras and the frame rate.")]
Certificate = Annotated[dict[str, Any], Body(description="A certificate.json, unchanged.")]
router = APIRouter(prefix="/v1/rigs", tags=["rigs"])


class RigDetail(BaseModel):
    """A certificate that is kept of a rig."""

    rig: str
    certificate: str
    cameras: int
    frame_rate_hz: float
    noise_per_grain: float | None
    created_at: datetime

    @classmethod
    def of(cls, row: RigCertificate) -> "RigDetail":
        """From its row."""
        return cls(
            rig=row.rig,
            certificate=row.id,
            cameras=len(row.document["cameras"]),
            frame_rate_hz=row.document["frame_rate_hz"],
            noise_per_grain=row.document.get("noise_per_grain"),
            created_at=datetime.fromtimestamp(row.created_at, UTC),
        )


class RigList(BaseModel):
    """The newest certificates first."""

    items: list[RigDetail]


@router.post("", status_code=201)
def store(document: Certificate, parts: TheParts, owner: Submitter, response: Response) -> RigDetail:
    """Keep a certificate. The same one again changes nothing."""
    checked = check_certificate(document)
    row = parts.store.write(lambda session: add_certificate(session, checked, owner=owner))
    response.headers["Location"] = f"/v1/rigs/{row.rig}/certificate"
    return RigDetail.of(row)


@router.get("")
def list_(parts: TheParts, owner: Owner) -> RigList:
    """The certificates that are kept, the newest first, at most 200."""
    with parts.store.read() as session:
        return RigList(items=[RigDetail.of(row) for row in list_certificates(session, owner=owner)])


@router.get("/{rig_id}/certificate")
def certificate(rig_id: RigId, parts: TheParts, owner: Owner) -> dict[str, Any]:
    """The newest certificate of a rig."""
    with parts.store.read() as session:
        return newest_certificate(session, rig_id, owner=owner).document
