"""The states of a scan and of a step, and the moves between them, as two tables. Pure data.

A move that is not in its table raises `IllegalTransition`; the rows are moved in `transitions`, nowhere else.
"""

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import TypeVar

from scanjobs.errors import IllegalTransition


class ScanState(StrEnum):
    """Where a scan stands; the first five words of HTTP are queued running succeeded failed canceled."""

    UPLOADING = "uploading"
    QUEUED = "queued"
    RUNNING = "running"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELING = "canceling"
    CANCELED = "canceled"
    DELETING = "deleting"
    DELETED = "deleted"


class StepState(StrEnum):
    """Where a step stands; a `sent` step is claimed by its message, a `ready` one by a slot that goes on with it."""

    PENDING = "pending"
    READY = "ready"
    SENT = "sent"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"


State = TypeVar("State", ScanState, StepState)

SCAN_MOVES: Mapping[ScanState, frozenset[ScanState]] = MappingProxyType(
    {
        ScanState.UPLOADING: frozenset({ScanState.QUEUED, ScanState.CANCELING}),
        ScanState.QUEUED: frozenset(
            {ScanState.RUNNING, ScanState.PAUSED, ScanState.CANCELING, ScanState.SUCCEEDED, ScanState.FAILED}
        ),
        ScanState.RUNNING: frozenset({ScanState.SUCCEEDED, ScanState.FAILED, ScanState.PAUSED, ScanState.CANCELING}),
        ScanState.PAUSED: frozenset(
            {ScanState.QUEUED, ScanState.RUNNING, ScanState.SUCCEEDED, ScanState.CANCELING, ScanState.FAILED}
        ),
        ScanState.CANCELING: frozenset({ScanState.CANCELED}),
        ScanState.SUCCEEDED: frozenset({ScanState.QUEUED, ScanState.DELETING}),
        ScanState.FAILED: frozenset({ScanState.QUEUED, ScanState.DELETING}),
        ScanState.CANCELED: frozenset({ScanState.QUEUED, ScanState.DELETING}),
        ScanState.DELETING: frozenset({ScanState.DELETED}),
        ScanState.DELETED: frozenset(),
    }
)

STEP_MOVES: Mapping[StepState, frozenset[StepState]] = MappingProxyType(
    {
        StepState.PENDING: frozenset({StepState.READY, StepState.FAILED, StepState.CANCELED}),
        StepState.READY: frozenset(
            {StepState.SENT, StepState.RUNNING, StepState.SUCCEEDED, StepState.FAILED, StepState.CANCELED}
        ),
        StepState.SENT: frozenset({StepState.READY, StepState.RUNNING, StepState.FAILED, StepState.CANCELED}),
        StepState.RUNNING: frozenset({StepState.SUCCEEDED, StepState.READY, StepState.FAILED, StepState.CANCELED}),
        StepState.SUCCEEDED: frozenset(),
        StepState.FAILED: frozenset(),
        StepState.CANCELED: frozenset(),
    }
)

TERMINAL_SCAN_STATES = frozenset({ScanState.SUCCEEDED, ScanState.FAILED, ScanState.CANCELED})
ENDED_SCAN_STATES = TERMINAL_SCAN_STATES | {ScanState.DELETING, ScanState.DELETED}
LIVE_STEP_STATES = frozenset({StepState.PENDING, StepState.READY, StepState.SENT, StepState.RUNNING})
WORKING_SCAN_STATES = frozenset({ScanState.QUEUED, ScanState.RUNNING})
"""Their steps are begun."""
OPEN_SCAN_STATES = WORKING_SCAN_STATES | {ScanState.PAUSED}
"""Their results count: a step that was under way when its scan was paused still ends."""


def check_move(current: State, target: State) -> None:
    """Raise `IllegalTransition` unless the table lets `current` become `target`."""
    if target not in _moves_from(current):
        kind = "scan" if isinstance(current, ScanState) else "step"
        raise IllegalTransition(
            f"a {kind} that is {current.value} cannot become {target.value}.",
            hint=_remedy(current),
        )


def origins(target: State) -> tuple[State, ...]:
    """Every state from which `target` can be reached in one move."""
    if isinstance(target, ScanState):
        return tuple(state for state, targets in SCAN_MOVES.items() if target in targets)
    return tuple(state for state, targets in STEP_MOVES.items() if target in targets)


def _moves_from(current: State) -> frozenset[State]:
    if isinstance(current, ScanState):
        return SCAN_MOVES[current]
    return STEP_MOVES[current]


def _remedy(current: ScanState | StepState) -> str:
    if not isinstance(current, ScanState):
        return "Look at the step's events to see who moved it."
    if current in TERMINAL_SCAN_STATES:
        return "It has ended; retry it or submit it again."
    return "Wait until it has ended, or cancel it."
