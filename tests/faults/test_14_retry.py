"""Fault 14: a retry from the identification, a changed option, and a retry of frames 3 and 7."""

from nerfmodal.spec import IdentificationSpec
from scanjobs import control
from scanjobs.messages import EXTRACT, IDENTIFY, TRAIN
from scanjobs.settings import Settings

from tests.integration.toy_service import Service, serving, toy_spec


def computed(service: Service, scan_id: str) -> set[tuple[str, int]]:
    """The steps of the present generation that were computed, not taken over."""
    return {(step.kind, step.frame) for step in service.steps(scan_id) if step.token}


def test_only_what_has_changed_is_computed_again(settings: Settings) -> None:
    """Guards: a retry keeps what had succeeded (`control._kept`); a fork finds steps by the digest of their inputs
    (`fanin.take_over`).

    Seen to fail: with `_same_step` returning None the fork computes everything; with `_kept` returning nothing as well
    (each alone is enough for a retry) the retry does.
    """
    with serving(settings) as service:
        spec = toy_spec(frames=8)
        scan_id = service.submit(spec)
        first = service.end_of(scan_id)
        assert first.state == "succeeded"
        service.store.write(lambda session: control.retry_scan(session, scan_id, from_kind=IDENTIFY))
        assert (service.end_of(scan_id).generation, computed(service, scan_id)) == (1, {(IDENTIFY, -1)})

        other = spec.model_copy(update={"identification": IdentificationSpec(max_modes=3)})
        fork = service.store.write(lambda session: control.fork_scan(session, scan_id, other))
        assert service.end_of(fork.id).state == "succeeded"
        assert computed(service, fork.id) == {(IDENTIFY, -1)}

        service.store.write(lambda session: control.retry_scan(session, scan_id, from_kind=TRAIN, frames=[3, 7]))
        assert service.end_of(scan_id).state == "succeeded"
        assert computed(service, scan_id) == {(TRAIN, 3), (EXTRACT, 3), (TRAIN, 7), (EXTRACT, 7), (IDENTIFY, -1)}
        assert service.violations() == ()
