"""Why a plant has alarms, in words that say what changed, since when, how sure that is and how long it took."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from sqlalchemy import select
from sqlalchemy.orm import Session

from scanjobs.fleet.alarms import DRIFT, LOST_MODE, SCANS_FAILING, Reason, evidence_of
from scanjobs.fleet.findings import Findings
from scanjobs.fleet.tables import Plant, Track
from scanjobs.fleet.tracks import name_of
from scanjobs.monitoring.drift import Finding
from scanjobs.monitoring.tracking import Rules
from scanjobs.states import TERMINAL_SCAN_STATES, ScanState
from scanjobs.tables import Scan

FAILED_IN_A_ROW: Final = 3
ESTABLISHED: Final = 6
"""Scans that a mode must have been seen in to be missed."""
CHART_WORDS: Final = {"ewma": "EWMA", "cusum_up": "CUSUM", "cusum_down": "CUSUM", "t2": "Hotelling's T²"}
SURROUNDINGS: Final = {
    "temperature_c": "temperature",
    "humidity_percent": "humidity",
    "light_umol_m2_s": "light",
    "soil_water_percent": "soil water",
    "mass_g": "mass",
}
"""What columns are called within a sentence; those of the owner's own by their names."""
Reasons = dict[tuple[str, str], Reason]


def reasons_for(session: Session, plant: Plant, found: Findings) -> Reasons:
    """Every reason that the plant's data give, by kind and subject."""
    reasons = [*_lost_modes(plant, found), *_failing(session, plant)]
    if found.drift is not None and found.drift.finding is not None:
        reasons.append(_drift(found, found.drift.finding))
    return {(reason.kind, reason.subject): reason for reason in reasons}


def _beyond(covariates: Sequence[str]) -> str:
    """What is taken off a change before it is told, as the end of a sentence."""
    words = [SURROUNDINGS.get(name, name) for name in covariates]
    verb = "explains" if len(words) == 1 else "explain"
    return f" beyond what {' and '.join(words)} {verb}" if words else ""


def _drift(found: Findings, finding: Finding) -> Reason:
    onset, detected = found.scans[finding.onset], found.scans[finding.detected]
    way = "lower" if finding.change < 0 else "higher"
    size = f"{100 * abs(finding.change):.1f} %"
    moved = [found.tracks[k] for k in finding.tracks]
    names = ", ".join(name_of(row) for row in moved) or "no track by itself"
    charts = " and ".join(dict.fromkeys(CHART_WORDS[name] for name in finding.charts))
    beside = _beyond(found.drift.covariates if found.drift else ())
    what = (
        f"Since {_day(onset.at)} frequencies are {size} ± {100 * finding.change_std:.1f} % {way}{beside} ({names}). "
        f"{charts} showed it on {_day(detected.at)}, with scan {finding.delay_scans} of the change."
    )
    recovered = None if finding.recovered is None else found.scans[finding.recovered].at
    if recovered is not None:
        what += f" It has been back to normal since {_day(recovered)}."
    evidence = evidence_of(
        title=f"Frequencies {size} {way} since {_day(onset.at)}",
        what=what,
        since=onset.at,
        since_scan=onset.scan_id,
        detected_at=detected.at,
        detected_scan=detected.scan_id,
        delay_scans=finding.delay_scans,
        delay_s=finding.delay_s,
        change_percent=100 * finding.change,
        change_percent_std=100 * finding.change_std,
        confidence=finding.confidence,
        charts=list(finding.charts),
        tracks=[row.id for row in moved],
        recovered_at=recovered,
    )
    return Reason(kind=DRIFT, severity=finding.severity, evidence=evidence)


def _lost_modes(plant: Plant, found: Findings) -> list[Reason]:
    return [
        _lost(found, row)
        for row in found.tracks
        if not row.active
        and not row.by_hand
        and row.scans >= ESTABLISHED
        and (plant.charts_from is None or row.last_seen_at > plant.charts_from)
    ]


def _lost(found: Findings, row: Track) -> Reason:
    later = [scan for scan in found.scans if scan.at > row.last_seen_at]
    seen_in = {mode.scan_id for mode in found.modes if mode.organ == row.organ}
    later = [scan for scan in later if scan.scan_id in seen_in]
    told = later[min(Rules().patience, len(later) - 1)]
    what = f"{name_of(row)}, last seen at {row.frequency_hz:.3f} Hz on {_day(row.last_seen_at)}, is not found any more."
    heirs = [one for one in found.tracks if one.organ == row.organ and one.born_at > row.last_seen_at and one.active]
    if heirs:
        near = min(heirs, key=lambda one: abs(one.frequency_hz - row.frequency_hz))
        what += f" {name_of(near)} began since then at {near.frequency_hz:.3f} Hz: if it is the same mode, merge them."
    evidence = evidence_of(
        title=f"Mode {name_of(row)} is lost",
        what=what,
        since=later[0].at,
        since_scan=later[0].scan_id,
        detected_at=told.at,
        detected_scan=told.scan_id,
        delay_scans=min(Rules().patience + 1, len(later)),
        delay_s=told.at - later[0].at,
        tracks=[row.id],
    )
    return Reason(kind=LOST_MODE, subject=row.id, severity="warning", evidence=evidence)


def _failing(session: Session, plant: Plant) -> list[Reason]:
    ended = [state.value for state in TERMINAL_SCAN_STATES]
    query = select(Scan.id, Scan.state, Scan.created_at, Scan.error)
    query = query.where(Scan.owner == plant.owner, Scan.plant == plant.id, Scan.state.in_(ended))
    rows = session.execute(query.order_by(Scan.id.desc()).limit(FAILED_IN_A_ROW)).all()
    if len(rows) < FAILED_IN_A_ROW or any(row[1] != ScanState.FAILED for row in rows):
        return []
    last, first = rows[0], rows[-1]
    error = last[3] or {}
    evidence = evidence_of(
        title=f"The last {FAILED_IN_A_ROW} scans failed",
        what=f"The newest one at {error.get('step') or 'its end'}: {error.get('message') or 'no reason given.'}",
        since=first[2],
        since_scan=first[0],
        detected_at=last[2],
        detected_scan=last[0],
        delay_scans=FAILED_IN_A_ROW,
        delay_s=last[2] - first[2],
    )
    return [Reason(kind=SCANS_FAILING, severity="warning", evidence=evidence)]


def _day(at: float) -> str:
    return f"{datetime.fromtimestamp(at, UTC):%d %b %Y}"
