"""Fault 11: a frame always runs out of memory, by itself or by the kernel's hand."""

from scanjobs.messages import IDENTIFY, TRAIN
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.integration.toy_service import serving, toy_spec


def test_frame_that_never_fits_is_given_up_after_its_attempts(settings: Settings) -> None:
    """It is lost like any other frame; the words tell what to do; the other scan on the worker does not suffer.

    Guard: attempts are counted and bounded (`leases._after_failure`).
    Seen to fail: with `attempt < max_attempts` replaced by True the frame is tried for ever and no scan ends.
    """
    twice = settings.model_copy(update={"max_attempts": 2})
    with serving(twice) as service:
        trouble = f"{TRAIN}:1:memory {TRAIN}:2:die"
        scan_id = service.submit(toy_spec(frames=4, trouble=trouble, max_failed_frames=2))
        other = service.submit(toy_spec(frames=2, seed=1))
        assert service.end_of(scan_id).state == service.end_of(other).state == "succeeded"
        asked, killed = service.step(scan_id, TRAIN, 1), service.step(scan_id, TRAIN, 2)
        assert [step.state for step in (asked, killed)] == [StepState.FAILED] * 2
        assert [step.attempt for step in (asked, killed)] == [2, 2]
        assert [(step.error or {})["code"] for step in (asked, killed)] == ["OUT_OF_MEMORY", "RUNNER_DIED"]
        assert all("memory" in str((step.error or {})["hint"]) for step in (asked, killed))
        assert {step.attempt for step in service.steps(scan_id) if step.frame in (0, 3) or step.kind == IDENTIFY} == {1}
        assert service.violations() == ()
