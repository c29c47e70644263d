"""The service's own cost of a step against the bare round trip of an empty Celery task, on the same Redis.

A step is claimed, handed to its runner, its file stored, its rows written and its children woken; a task is sent and
its result waited for. One slot each, one after the other.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from scanjobs.tables import Scan, Step
from sqlalchemy import func, select

from benchmarks.rows import Row
from benchmarks.service_servers import Servers
from tests.integration.toy_service import Service, looking_at, toy_spec, worker_process

TASKS = "benchmarks.empty_tasks"
FRAMES = 20
ROUND_TRIPS = 200
ROUNDS = 3


def step_rows(machine: Servers) -> Iterator[Row]:
    """Medians over rounds that take turns."""
    bare: list[float] = []
    ours: list[float] = []
    settings = machine.settings("steps", TASKS)
    with bare_worker(machine.redis.url), looking_at(settings) as service, worker_process(settings):
        _scan(service, 2, seed=0)  # every runner is started
        for turn in range(ROUNDS):
            bare.append(_round_trip(machine.redis.url))
            ours.append(_scan(service, FRAMES, seed=1 + turn))
    step, task = sorted(ours)[ROUNDS // 2], sorted(bare)[ROUNDS // 2]
    what = f"a step ({step * 1e3:.1f} ms) over an empty Celery task ({task * 1e3:.1f} ms)"
    yield Row(what=what, value=step / task, unit="x", floor=4.0, aim=2.0)


@contextmanager
def bare_worker(broker: str) -> Iterator[None]:
    """A Celery worker of one thread while the block runs."""
    command = [sys.executable, "-m", "celery", "-A", "benchmarks.bare_celery", "worker", "-P", "threads", "-c", "1"]
    command += ["--without-gossip", "--without-mingle", "--without-heartbeat", "-l", "ERROR"]
    process = subprocess.Popen(command, env={**os.environ, "BARE_BROKER": broker})
    try:
        yield
    finally:
        process.terminate()
        process.wait(15)


def _round_trip(broker: str) -> float:
    """Seconds from sending a task to holding its result."""
    os.environ["BARE_BROKER"] = broker
    from benchmarks.bare_celery import nothing  # here: the module reads the variable

    nothing.delay("0").get(timeout=60)
    began = time.perf_counter()
    for number in range(ROUND_TRIPS):
        nothing.delay(str(number)).get(timeout=60)
    return (time.perf_counter() - began) / ROUND_TRIPS


def _scan(service: Service, frames: int, *, seed: int) -> float:
    """Seconds per step from the first claim of a scan to its end, by the database's clock."""
    scan_id = service.submit(toy_spec(frames=frames, seed=seed))
    assert service.end_of(scan_id, 120).state == "succeeded"
    with service.store.read() as session:
        query = select(Scan.finished_at - Scan.started_at, func.count(Step.id)).join(Step, Step.scan_id == Scan.id)
        took, steps = session.execute(query.where(Scan.id == scan_id).group_by(Scan.id)).one()
    return float(took) / int(steps)
