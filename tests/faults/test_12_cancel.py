"""Fault 12: a cancel in each kind of step."""

import time

from nerfmodal.spec import ScanSpec
from scanjobs import control
from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, READ, RENDER, TRAIN
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.faults.steps import seconds_since
from tests.integration.toy_service import is_alive, serving, toy_spec

SIMULATED = [(RENDER, 0), (TRAIN, -1), (TRAIN, 1), (EXTRACT, 0), (IDENTIFY, -1)]
CAPTURED = [(INSPECT, -1), (READ, 1)]


def captured(trouble: str) -> ScanSpec:
    """A capture of two frames."""
    plant = {"id": "toy", "treatment": trouble}
    return ScanSpec.model_validate({"source": {"kind": "capture", "path": "/nowhere"}, "plant": plant})


def test_cancel_stops_every_kind_of_step_within_five_seconds(settings: Settings) -> None:
    """Promise (e), with seven scans on one worker, each in another kind of step.

    Guard: `Standing.CANCELED` makes the supervisor stop its runner (`Supervisor._go_on`).
    Seen to fail: with `leases.standing` never answering CANCELED the steps compute on for a minute.
    """
    wide = settings.model_copy(update={"slots": 7})
    with serving(wide) as service:
        simulated = [
            (service.submit(toy_spec(frames=2, trouble=f"{kind}:{k}:slow", seed=n)), kind, k)
            for n, (kind, k) in enumerate(SIMULATED)
        ]
        inspected = [(service.submit(captured(f"{kind}:{k}:slow")), kind, k) for kind, k in CAPTURED]
        runners = [service.runner_of(*one) for one in simulated + inspected]
        asked_at = time.monotonic()
        for scan_id, _, _ in simulated + inspected:
            service.store.write(lambda session, one=scan_id: control.cancel_scan(session, one))
        for scan_id, _, _ in simulated + inspected:
            assert service.end_of(scan_id, 5).state == "canceled"
            assert {step.state for step in service.steps(scan_id)} <= {StepState.CANCELED, StepState.SUCCEEDED}
        assert seconds_since(asked_at) < 5
        assert not any(is_alive(pid) for pid in runners)
        assert service.violations() == ()
