"""The tables of moves: closed, without a way out of the end, and the only word on what is allowed."""

from itertools import product

import pytest
from scanjobs.errors import IllegalTransition
from scanjobs.states import SCAN_MOVES, STEP_MOVES, ScanState, StepState, check_move, origins


def test_every_state_has_its_row() -> None:
    assert set(SCAN_MOVES) == set(ScanState)
    assert set(STEP_MOVES) == set(StepState)


def test_nothing_leaves_the_end_of_a_step() -> None:
    for state in (StepState.SUCCEEDED, StepState.FAILED, StepState.CANCELED):
        assert not STEP_MOVES[state]


@pytest.mark.parametrize(("current", "target"), [*product(StepState, repeat=2)])
def test_steps_move_by_their_table_alone(current: StepState, target: StepState) -> None:
    assert is_allowed(current, target) == (target in STEP_MOVES[current]) == (current in origins(target))


@pytest.mark.parametrize(("current", "target"), [*product(ScanState, repeat=2)])
def test_scans_move_by_their_table_alone(current: ScanState, target: ScanState) -> None:
    assert is_allowed(current, target) == (target in SCAN_MOVES[current]) == (current in origins(target))


def test_refusal_names_the_present_state_and_a_remedy() -> None:
    with pytest.raises(IllegalTransition, match="canceling") as refusal:
        check_move(ScanState.CANCELING, ScanState.QUEUED)
    assert refusal.value.hint


def is_allowed(current: ScanState | StepState, target: ScanState | StepState) -> bool:
    """Whether the check lets it pass."""
    try:
        check_move(current, target)
    except IllegalTransition:
        return False
    return True


def test_only_a_waiting_step_can_run_and_only_a_running_one_fail_by_itself() -> None:
    assert origins(StepState.RUNNING) == (StepState.READY, StepState.SENT)
    assert origins(StepState.SENT) == (StepState.READY,)


def test_every_scan_that_has_begun_can_end() -> None:
    reached = {ScanState.QUEUED}
    while more := {target for state in reached for target in SCAN_MOVES[state]} - reached:
        reached |= more
    assert {ScanState.SUCCEEDED, ScanState.FAILED, ScanState.CANCELED, ScanState.DELETED} <= reached
