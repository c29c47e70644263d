"""A plan of several chunks, planted while its first steps are computed already."""

from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import control, dispatch, leases, repository, workers
from scanjobs.artifacts import ArtifactStore
from scanjobs.fanin import plant_next_chunk, unplanted_scans
from scanjobs.fsck import check
from scanjobs.leases import Claim, Failure
from scanjobs.messages import EXTRACT, IDENTIFY, QUEUES, RENDER, TRAIN
from scanjobs.plan import CHUNK
from scanjobs.states import StepState
from scanjobs.store import Store
from scanjobs.tables import Scan, Step
from scanjobs.workers import WorkerIdentity

FRAMES = CHUNK + 3


def spec_of(frames: int, max_failed_frames: int = 0, partial_every: int | None = None) -> ScanSpec:
    """A simulation."""
    motion = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.0, "amplitude_m": 0.01}
    source = {"kind": "simulation", "frames": frames, "frame_rate_hz": 30.0, "motion": [motion]}
    return ScanSpec.model_validate(
        {"source": source, "max_failed_frames": max_failed_frames, "partial_every": partial_every}
    )


@pytest.fixture
def busy(store: Store) -> Store:
    """A worker with room for everything."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=10_000)
    store.write(lambda session: workers.register(session, identity, 600.0))
    return store


def submit(store: Store, spec: ScanSpec) -> Scan:
    """A new scan."""
    return store.write(lambda session: repository.insert_scan(session, spec)).scan


def steps_of(store: Store) -> dict[tuple[str, int], Step]:
    """The steps of the only scan."""
    with store.read() as session:
        scan = repository.list_scans(session).items[0]
        return {(step.kind, step.frame): step for step in repository.list_steps(session, scan)}


def take(store: Store, kind: str, frame: int) -> Claim:
    """Claim one step."""
    store.write(dispatch.dispatch)
    step_id = steps_of(store)[kind, frame].id
    claim = store.write(lambda session: leases.claim(session, step_id, "w", 60.0))
    assert claim is not None
    return claim


def finish(store: Store, kind: str, frame: int) -> None:
    """Compute one step."""
    claim = take(store, kind, frame)
    assert store.write(lambda session: leases.finish(session, claim, (), {}))


def test_later_chunk_knows_what_has_become_of_its_parents(busy: Store, tmp_path: Path) -> None:
    """Frame 0 and the shared checkpoint end before the last chunk is planted: its trainings wait for less."""
    scan = submit(busy, spec_of(FRAMES))
    assert scan.unplanted_from == CHUNK
    finish(busy, RENDER, 0)
    finish(busy, TRAIN, -1)
    finish(busy, TRAIN, 0)
    finish(busy, EXTRACT, 0)
    with busy.read() as session:
        assert unplanted_scans(session) == (scan.id,)
    assert busy.write(lambda session: plant_next_chunk(session, scan.id))
    assert not busy.write(lambda session: plant_next_chunk(session, scan.id))
    steps = steps_of(busy)
    assert len(steps) == 3 * FRAMES + 2
    assert steps[TRAIN, CHUNK].deps_left == 1
    assert steps[IDENTIFY, -1].deps_left == FRAMES - 1
    with busy.read() as session:
        assert check(session, ArtifactStore(tmp_path / "artifacts")) == ()


def test_totals_count_what_is_not_planted_yet(busy: Store) -> None:
    scan = submit(busy, spec_of(FRAMES))
    with busy.read() as session:
        totals = {one.kind: one.total for one in repository.step_summaries(session, scan)}
    assert totals == {RENDER: FRAMES, TRAIN: FRAMES + 1, EXTRACT: FRAMES, IDENTIFY: 1}


def test_cancelled_scan_is_planted_no_further(busy: Store) -> None:
    scan = submit(busy, spec_of(FRAMES))
    busy.write(lambda session: control.cancel_scan(session, scan.id))
    assert not busy.write(lambda session: plant_next_chunk(session, scan.id))
    busy.write(lambda session: control.retry_scan(session, scan.id))
    assert len(steps_of(busy)) == 3 * FRAMES + 2


def test_frame_that_is_lost_before_the_identification_is_planted_is_a_gap_of_it(busy: Store) -> None:
    scan = submit(busy, spec_of(FRAMES, max_failed_frames=1))
    claim = take(busy, RENDER, 1)
    broken = Failure(code="BROKEN", message="it broke.", retryable=False)
    busy.write(lambda session: leases.fail(session, claim, broken, 3))
    busy.write(lambda session: plant_next_chunk(session, scan.id))
    assert steps_of(busy)[IDENTIFY, -1].deps_left == FRAMES  # every cloud but the lost one, and frame 0


def test_modes_so_far_are_given_all_earlier_clouds_and_end_with_the_scan(busy: Store, tmp_path: Path) -> None:
    """32 of 33 frames are partly identified twice; the second is still computing when the scan has its modes."""
    submit(busy, spec_of(33, partial_every=16))
    finish(busy, RENDER, 0)
    finish(busy, TRAIN, -1)
    for k in range(33):
        if k:
            finish(busy, RENDER, k)
        finish(busy, TRAIN, k)
        finish(busy, EXTRACT, k)
    finish(busy, IDENTIFY, 16)
    second = take(busy, IDENTIFY, 32)
    finish(busy, IDENTIFY, -1)
    steps = steps_of(busy)
    assert steps[IDENTIFY, 16].state == StepState.SUCCEEDED
    assert steps[IDENTIFY, 32].state == StepState.CANCELED
    assert not busy.write(lambda session: leases.finish(session, second, (), {}))
    with busy.read() as session:
        assert repository.list_scans(session).items[0].state == "succeeded"
        assert check(session, ArtifactStore(tmp_path / "artifacts")) == ()


def test_broken_partial_result_costs_the_scan_nothing(busy: Store) -> None:
    submit(busy, spec_of(17, partial_every=16))
    finish(busy, RENDER, 0)
    finish(busy, TRAIN, -1)
    for k in range(16):
        if k:
            finish(busy, RENDER, k)
        finish(busy, TRAIN, k)
        finish(busy, EXTRACT, k)
    claim = take(busy, IDENTIFY, 16)
    broken = Failure(code="BROKEN", message="it broke.", retryable=False)
    busy.write(lambda session: leases.fail(session, claim, broken, 3))
    with busy.read() as session:
        assert repository.list_scans(session).items[0].state == "running"
