"""One training per GPU, however a claim ends."""

from collections.abc import Callable

import pytest
from nerfmodal.spec import ReconstructionSpec, ScanSpec
from scanjobs import dispatch, leases, repository, workers
from scanjobs.clock import now_s
from scanjobs.leases import Claim, Failure
from scanjobs.messages import QUEUES, RENDER, TRAIN
from scanjobs.slots import Devices
from scanjobs.store import Store
from scanjobs.tables import Step
from scanjobs.workers import WorkerIdentity
from sqlalchemy import update
from sqlalchemy.orm import Session

TWO = Devices(host="here", gpus=2)
FRAMES = 3


@pytest.fixture
def trainings(store: Store, spec: ScanSpec) -> tuple[str, ...]:
    """Three trainings of large networks, all sent."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    large = spec.model_copy(update={"reconstruction": ReconstructionSpec(field="mlp")})
    scan = store.write(lambda session: repository.insert_scan(session, large)).scan
    for key in [(RENDER, k) for k in range(FRAMES)] + [(TRAIN, -1)]:
        store.write(dispatch.dispatch)
        claim = store.write(lambda session, one=key: leases.claim(session, find(session, *one), "w", 60.0))
        assert claim is not None
        store.write(lambda session, held=claim: leases.finish(session, held, (), {}))
    store.write(dispatch.dispatch)
    assert scan.state == "queued"
    with store.read() as session:
        return tuple(find(session, TRAIN, k) for k in range(FRAMES))


def find(session: Session, kind: str, frame: int) -> str:
    """Id of a step of the only scan."""
    return session.query(Step.id).filter(Step.kind == kind, Step.frame == frame).scalar()


def take(store: Store, step_id: str) -> Claim | None:
    """Claim on a machine of two GPUs."""
    return store.write(lambda session: leases.claim(session, step_id, "w", 60.0, TWO))


def again(store: Store, step_id: str) -> None:
    """Send a step that was put back."""
    store.write(lambda session: session.execute(update(Step).values(not_before=None)))
    store.write(dispatch.dispatch)
    with store.read() as session:
        assert dispatch.is_sent(session, step_id)


def expire(session: Session, held: Claim) -> bool:
    """The worker was not heard of any more."""
    session.execute(update(Step).where(Step.id == held.step_id).values(lease_until=now_s() - 1.0))
    return leases.reap(session, held.step_id, 3)


ENDS: dict[str, Callable[[Session, Claim], bool]] = {
    "finished": lambda session, held: leases.finish(session, held, (), {}),
    "failed": lambda session, held: leases.fail(session, held, Failure(code="X", message="x."), 3),
    "given back": lambda session, held: leases.give_back(session, held, "drain"),
    "reaped": expire,
}


@pytest.mark.parametrize("end", list(ENDS))
def test_third_training_waits_for_one_of_two_gpus(store: Store, trainings: tuple[str, ...], end: str) -> None:
    first, second = take(store, trainings[0]), take(store, trainings[1])
    assert first is not None
    assert second is not None
    assert {first.device, second.device} == {"gpu:0", "gpu:1"}
    assert take(store, trainings[2]) is None
    assert store.write(lambda session: ENDS[end](session, first))
    again(store, trainings[2])
    third = take(store, trainings[2])
    assert third is not None
    assert third.device == first.device


def test_another_host_has_its_own_gpus(store: Store, trainings: tuple[str, ...]) -> None:
    for step_id, host in zip(trainings, ("a", "a", "b"), strict=True):
        devices = Devices(host=host, gpus=2)
        claim = store.write(lambda session, one=step_id, here=devices: leases.claim(session, one, "w", 60.0, here))
        assert claim is not None


def test_machine_without_gpu_trains_on_its_processor(store: Store, trainings: tuple[str, ...]) -> None:
    none = Devices(host="here", gpus=0)
    claims = [store.write(lambda session, one=step: leases.claim(session, one, "w", 60.0, none)) for step in trainings]
    assert [claim.device for claim in claims if claim] == [None] * FRAMES
