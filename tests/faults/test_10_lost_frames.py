"""Fault 10: a frame fails for good, with no frame and with two frames that may be lost."""

from scanjobs.messages import EXTRACT, IDENTIFY, RENDER, TRAIN
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.integration.toy_service import serving, toy_spec

TROUBLE = f"{TRAIN}:1:invalid {RENDER}:3:invalid"


def test_lost_frames_fail_the_scan_or_are_a_gap_of_it(settings: Settings) -> None:
    """Three scans at once: none may be lost, one may, two may. The gap reaches the identification as missing files.

    Guard: `fanin.lose_frame` (its limit, and that it wakes what waits for the frame).
    Seen to fail: without the limit the first two scans succeed; without `release_children` the third never ends.
    """
    with serving(settings) as service:
        ids = [service.submit(toy_spec(frames=5, trouble=TROUBLE, max_failed_frames=most)) for most in (0, 1, 2)]
        ends = [service.end_of(scan_id) for scan_id in ids]
        assert [scan.state for scan in ends] == ["failed", "failed", "succeeded"]
        error = ends[0].error or {}
        assert error["code"] == "INVALID_INPUT"
        assert error["hint"] == "Mend the toy."
        states = {(step.kind, step.frame): step.state for step in service.steps(ids[2])}
        assert states.pop((IDENTIFY, -1)) == StepState.SUCCEEDED
        lost = {key for key, state in states.items() if state == StepState.FAILED}
        assert lost == {(TRAIN, 1), (EXTRACT, 1), (RENDER, 3), (TRAIN, 3), (EXTRACT, 3)}
        assert identified_clouds(service.step(ids[2], IDENTIFY, -1).facts) == [0, 2, 4]
        assert service.violations() == ()


def identified_clouds(facts: dict[str, object] | None) -> object:
    """The frames whose clouds the identification was given."""
    return (facts or {})["clouds"]
