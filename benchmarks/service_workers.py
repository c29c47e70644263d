"""Wall time of 8 frames on two workers against one, a slot and a thread each; the steps burn processor time."""

from collections.abc import Iterator
from contextlib import ExitStack

from benchmarks.rows import Row
from benchmarks.service_servers import Servers
from tests.integration.toy_service import Service, looking_at, toy_spec, worker_process

TASKS = "benchmarks.burning_tasks"
FRAMES = 8


def worker_rows(machine: Servers) -> Iterator[Row]:
    """One worker, then two; runners are warm in both."""
    one, two = (_wall(machine, count) for count in (1, 2))
    what = f"wall time of {FRAMES} frames on two workers ({two:.1f} s) over one ({one:.1f} s)"
    yield Row(what=what, value=two / one, unit="x", floor=0.58, aim=0.52)


def _wall(machine: Servers, workers: int) -> float:
    settings = machine.settings(f"workers_{workers}", TASKS)
    with ExitStack() as running:
        service = running.enter_context(looking_at(settings))
        for _ in range(workers):
            running.enter_context(worker_process(settings))
        _scan(service, 2 * workers, seed=0)
        return _scan(service, FRAMES, seed=1)


def _scan(service: Service, frames: int, *, seed: int) -> float:
    """Seconds from the first claim to the end, by the database's clock."""
    scan_id = service.submit(toy_spec(frames=frames, seed=seed))
    ended = service.end_of(scan_id, 300)
    assert ended.state == "succeeded", ended.error
    assert ended.finished_at is not None
    assert ended.started_at is not None
    return ended.finished_at - ended.started_at
