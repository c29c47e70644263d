"""What an operator and a user may do to work that is under way: pause, limit, look at the modes so far."""

import time
from itertools import pairwise

from nerfmodal.spec import ReconstructionSpec
from scanjobs import pausing, repository, workers
from scanjobs.messages import IDENTIFY, RENDER, TRAIN
from scanjobs.migrate import upgrade
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings

from tests.integration.toy_service import Service, is_alive, looking_at, serving, toy_spec


def all_workers(service: Service) -> list[str]:
    """Ids of the workers that live."""
    with service.store.read() as session:
        return [worker.id for worker in repository.list_workers(session)]


def claims(service: Service, scan_id: str) -> int:
    """How many steps were begun."""
    return sum(step.token for step in service.steps(scan_id))


def test_paused_scan_begins_nothing_while_another_goes_on(service: Service) -> None:
    scan_id = service.submit(toy_spec(frames=3, trouble=f"{TRAIN}:-1:takes=1"))
    service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
    service.store.write(lambda session: pausing.pause_scan(session, scan_id))
    service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).state == "succeeded")
    begun = claims(service, scan_id)
    assert service.end_of(service.submit(toy_spec(frames=1, seed=1))).state == "succeeded"
    assert claims(service, scan_id) == begun
    service.store.write(lambda session: pausing.resume_scan(session, scan_id))
    assert service.end_of(scan_id).state == "succeeded"


def test_paused_worker_finishes_what_it_computes_and_begins_nothing(service: Service) -> None:
    scan_id = service.submit(toy_spec(frames=2, trouble=f"{TRAIN}:-1:takes=1"))
    runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
    service.store.write(lambda session: workers.pause(session, all_workers(service)))
    assert is_alive(runner)
    service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).state == "succeeded")
    begun = claims(service, scan_id)
    time.sleep(1.0)
    assert claims(service, scan_id) == begun
    service.store.write(lambda session: workers.resume(session, all_workers(service)))
    assert service.end_of(scan_id).state == "succeeded"


def test_low_disk_pauses_scans_and_room_resumes_them(settings: Settings) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(frames=1))
        with serving(settings.model_copy(update={"disk_low_mb": 10**9})):
            service.wait(lambda: service.scan(scan_id).state == "paused")
            assert service.scan(scan_id).paused_for == "disk_low"
        with serving(settings):
            assert service.end_of(scan_id).state == "succeeded"
            assert service.violations() == ()


def test_modes_so_far_are_there_before_the_scan_has_ended(service: Service) -> None:
    """The last frame takes long; meanwhile the modes of the first sixteen are found, and say what they are of."""
    spec = toy_spec(frames=17, trouble=f"{RENDER}:16:slow").model_copy(update={"partial_every": 16})
    scan_id = service.submit(spec)
    service.wait(lambda: service.step(scan_id, IDENTIFY, 16).state == "succeeded")
    assert service.scan(scan_id).state == "running"
    assert (service.step(scan_id, IDENTIFY, 16).facts or {})["clouds"] == list(range(16))
    with service.store.read() as session:
        totals = {one.kind: one.total for one in repository.step_summaries(session, service.scan(scan_id))}
    assert totals[IDENTIFY] == 1
    service.store.write(lambda session: pausing.pause_scan(session, scan_id))


def test_specification_may_limit_its_steps_and_its_whole_time(service: Service) -> None:
    limited = toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow").model_copy(update={"step_limit_s": 0.5})
    late = toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow", seed=1).model_copy(update={"deadline_s": 2.0})
    ids = [service.submit(limited), service.submit(late)]
    codes = [(service.end_of(scan_id).error or {})["code"] for scan_id in ids]
    assert codes == ["STEP_TOO_LONG", "DEADLINE_PASSED"]


def test_two_trainings_share_one_gpu_one_after_the_other(settings: Settings) -> None:
    """Four slots, one GPU: each training has the device for itself, renderings do not wait for it."""
    with serving(settings.model_copy(update={"gpus": 1, "slots": 4})) as service:
        large = ReconstructionSpec(field="mlp")
        trouble = " ".join(f"{TRAIN}:{k}:takes=0.5" for k in range(3))
        scan_id = service.submit(toy_spec(frames=3, trouble=trouble).model_copy(update={"reconstruction": large}))
        assert service.end_of(scan_id).state == "succeeded"
        trained = sorted(
            (step.started_at or 0.0, step.finished_at or 0.0, (step.facts or {})["gpu"])
            for step in service.steps(scan_id)
            if step.kind == TRAIN
        )
        assert [gpu for _, _, gpu in trained] == ["0"] * 4
        assert all(before[1] <= after[0] for before, after in pairwise(trained))
        assert service.violations() == ()


def test_long_plan_is_planted_while_its_first_frames_are_computed(settings: Settings) -> None:
    """A thousand frames: the submission returns at once, and the whole plan is there soon after."""
    spec = toy_spec(frames=1000, trouble=f"{RENDER}:0:slow")
    with serving(settings) as service:
        began = time.monotonic()
        scan_id = service.submit(spec)
        submitted = time.monotonic() - began
        assert service.scan(scan_id).unplanted_from is not None
        service.runner_of(scan_id, RENDER, 0)
        service.wait(lambda: service.scan(scan_id).unplanted_from is None)
        assert len(service.steps(scan_id)) == 3 * 1000 + 2
        assert submitted < time.monotonic() - began
        assert service.violations() == ()
