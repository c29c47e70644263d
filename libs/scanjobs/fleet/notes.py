"""Every move of a scan that names a plant is noted in the plant's row, in the transaction that makes the move.

Lists show the plant's last scan without looking for it, and `touched` grows where tracks may have to be computed again.
"""

from typing import Any

from nerfmodal.spec import PlantSpec
from sqlalchemy import or_, update
from sqlalchemy.orm import Session

from scanjobs.fleet.plants import UNSYNCHRONISED, ensure_plant
from scanjobs.fleet.tables import Plant
from scanjobs.states import ENDED_SCAN_STATES, ScanState
from scanjobs.tables import Scan


def note_scan(session: Session, scan: Scan, *, born: bool = False) -> None:
    """Write into the plant's row, in the transaction that moves the scan, what lists show of it."""
    if scan.plant is None:
        return
    if born:
        ensure_plant(session, PlantSpec.model_validate(scan.spec["plant"]), owner=scan.owner)
    mine = (Plant.owner == scan.owner, Plant.id == scan.plant)
    ended = ScanState(scan.state) in ENDED_SCAN_STATES
    changes: dict[str, Any] = {"scans": Plant.scans + int(born), "touched": Plant.touched + int(ended)}
    session.execute(update(Plant).where(*mine).values(changes), execution_options=UNSYNCHRONISED)
    is_last = or_(Plant.last_scan_id.is_(None), Plant.last_scan_id <= scan.id)
    seen = {"last_scan_id": scan.id, "last_scan_state": scan.state, "last_scan_at": scan.created_at}
    session.execute(update(Plant).where(*mine, is_last).values(seen), execution_options=UNSYNCHRONISED)
