"""The rows that a scan of point clouds leaves behind: itself, two steps, their attempts, events and files."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any, Final

from scanjobs.artifacts import Stored
from scanjobs.fanin import STORED
from scanjobs.fleet.seeding_files import FRAMES
from scanjobs.media import media_type_of
from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, QUEUE_OF
from scanjobs.plan import WHOLE_SCAN
from scanjobs.states import ScanState, StepState
from scanjobs.tables import Artifact, ArtifactRef, Attempt, Event, Scan, ScanTag, Step, StepDependency

END_S: Final = 240.0
"""From a scan's submission to its end."""
WORKER: Final = "00000000-0000-7000-8000-000000000000"
ERROR: Final = {
    "step": IDENTIFY,
    "frame": WHOLE_SCAN,
    "code": "INVALID_CLOUDS",
    "message": "no organ was found in the clouds: the camera was moved.",
    "hint": "Put the rig back and scan again.",
    "retryable": False,
}
SCAN_WAY: Final = (ScanState.QUEUED, ScanState.RUNNING)
FIRST_WAY: Final = (StepState.READY, StepState.SENT, StepState.RUNNING)
SECOND_WAY: Final = (StepState.PENDING, *FIRST_WAY)
Rows = Mapping[Any, list[dict[str, Any]]]


def rows_of_scan(
    ids: Sequence[str],
    owner: str,
    plant: str,
    spec: dict[str, Any],
    at: float,
    files: Mapping[str, Stored],
    *,
    failed: bool = False,
    frames: int = FRAMES,
) -> Rows:
    """Rows by table; `ids` are of the scan, of its inspection and of its identification."""
    scan_id, inspect_id, identify_id = ids
    ended = StepState.FAILED if failed else StepState.SUCCEEDED
    end = ScanState.FAILED if failed else ScanState.SUCCEEDED
    made = {} if failed else files
    return {
        Scan: [_scan(scan_id, owner, plant, spec, at, end, frames)],
        ScanTag: [{"scan_id": scan_id, "tag": tag} for tag in spec["tags"]],
        Step: [
            _step(inspect_id, scan_id, INSPECT, 0, StepState.SUCCEEDED, at) | {"facts": {"frames": frames}},
            _step(identify_id, scan_id, IDENTIFY, 1, ended, at),
        ],
        StepDependency: [{"parent_id": inspect_id, "child_id": identify_id}],
        Attempt: [
            _attempt(inspect_id, "succeeded", at),
            _attempt(identify_id, "failed" if failed else "succeeded", at),
        ],
        Event: [
            *_events(scan_id, None, (*SCAN_WAY, end), at),
            *_events(scan_id, inspect_id, (*FIRST_WAY, StepState.SUCCEEDED), at),
            *_events(scan_id, identify_id, (*SECOND_WAY, ended), at),
        ],
        Artifact: [_artifact(role, stored, at) for role, stored in made.items()],
        ArtifactRef: [_reference(identify_id, role, role.rpartition("/")[2], stored) for role, stored in made.items()],
    }


def rows_of_drawing(
    step_id: str, scan_id: str, at: float, files: Mapping[str, Stored], names: Mapping[str, str]
) -> Rows:
    """The step that made a scan's first cloud, with its files by role."""
    return {
        Step: [_step(step_id, scan_id, EXTRACT, 0, StepState.SUCCEEDED, at) | {"frame": 0}],
        Attempt: [_attempt(step_id, "succeeded", at)],
        Event: _events(scan_id, step_id, (*FIRST_WAY, StepState.SUCCEEDED), at),
        Artifact: [_artifact(names[role], stored, at) for role, stored in files.items()],
        ArtifactRef: [_reference(step_id, role, names[role], stored) for role, stored in files.items()],
    }


def _reference(step_id: str, role: str, name: str, stored: Stored) -> dict[str, Any]:
    return {"step_id": step_id, "role": role, "name": name, "digest": stored.digest}


def _scan(
    scan_id: str, owner: str, plant: str, spec: dict[str, Any], at: float, state: ScanState, frames: int
) -> dict[str, Any]:
    return {
        "id": scan_id,
        "owner": owner,
        "root_id": scan_id,
        "name": spec["name"],
        "source_kind": spec["source"]["kind"],
        "spec": spec,
        "spec_digest": sha256(repr(spec).encode()).hexdigest(),
        "plant": plant,
        "state": state.value,
        "generation": 0,
        "priority": 0,
        "version": 3,
        "cancel_seq": 0,
        "max_failed_frames": 0,
        "frames": frames,
        "served": 2,
        "error": dict(ERROR) if state is ScanState.FAILED else None,
        "created_at": at,
        "started_at": at + 2.0,
        "finished_at": at + END_S,
    }


def _step(step_id: str, scan_id: str, kind: str, depth: int, state: StepState, at: float) -> dict[str, Any]:
    return {
        "id": step_id,
        "scan_id": scan_id,
        "kind": kind,
        "frame": WHOLE_SCAN,
        "generation": 0,
        "queue": QUEUE_OF[kind],
        "depth": depth,
        "state": state.value,
        "deps_left": 0,
        "fresh": False,
        "attempt": 1,
        "token": 1,
        "progress_done": 1,
        "progress_total": 1,
        "progress_message": "",
        "facts": None,
        "error": dict(ERROR) if state is StepState.FAILED else None,
        "created_at": at,
        "started_at": at + 2.0 + 10.0 * depth,
        "finished_at": at + (10.0 if kind == INSPECT else END_S),
    }


def _attempt(step_id: str, outcome: str, at: float) -> dict[str, Any]:
    return {
        "step_id": step_id,
        "token": 1,
        "worker_id": WORKER,
        "started_at": at + 2.0,
        "ended_at": at + END_S,
        "outcome": outcome,
        "counted": True,
    }


def _events(scan_id: str, step_id: str | None, way: Sequence[str], at: float) -> list[dict[str, Any]]:
    before = [None, *way[:-1]]
    return [
        {
            "scan_id": scan_id,
            "step_id": step_id,
            "generation": 0,
            "from_state": None if one is None else str(one),
            "to_state": str(other),
            "reason": "demo",
            "at": at + k,
        }
        for k, (one, other) in enumerate(zip(before, way, strict=True))
    ]


def _artifact(role: str, stored: Stored, at: float) -> dict[str, Any]:
    return {
        "digest": stored.digest,
        "size": stored.size,
        "media_type": media_type_of(role),
        "state": STORED,
        "created_at": at,
    }
