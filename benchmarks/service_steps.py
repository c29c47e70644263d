"""The service's own cost of a step against the bare round trip of an empty Celery task, on the same Redis.

A step is claimed, handed to its runner, its file stored and synced, its rows written, its children woken and the next
one claimed; a task is sent and its result waited for. Two rows: one after the other (one slot: latency), and many in
flight on two slots (throughput). The syncs of a step that the disk must answer (a file, its folder, PostgreSQL's log)
are timed beside: no design that keeps its promises is faster.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from celery.result import ResultSet
from scanjobs.tables import Scan, Step
from sqlalchemy import func, select

from benchmarks.rows import Row
from benchmarks.service_servers import Servers
from tests.integration.toy_service import Service, looking_at, toy_spec, worker_process

TASKS = "benchmarks.empty_tasks"
FRAMES = 20
ROUND_TRIPS = 200
ROUNDS = 3
IN_FLIGHT = 4
"""Scans at once, on two slots."""
SYNCS = 100


def step_rows(machine: Servers) -> Iterator[Row]:
    """Medians over rounds that take turns."""
    disk = _syncs(machine.folder)
    step, task = _alone(machine)
    what = (
        f"a step ({step * 1e3:.1f} ms; {disk * 1e3:.1f} are the disk's) over an empty Celery task ({task * 1e3:.1f} ms)"
    )
    yield Row(what=what, value=step / task, unit="x", floor=4.0, aim=2.0)
    step, task = _many(machine)
    what = f"a step among many ({1 / step:.0f}/s on two slots) over an empty task among many ({1 / task:.0f}/s)"
    yield Row(what=what, value=step / task, unit="x", floor=4.0, aim=2.0)


def _alone(machine: Servers) -> tuple[float, float]:
    """Seconds of a step and of a task, one after the other."""
    bare: list[float] = []
    ours: list[float] = []
    settings = machine.settings("steps", TASKS)
    with bare_worker(machine.redis.url, 1), looking_at(settings) as service, worker_process(settings):
        _scans(service, 1, 2, seed=0)  # every runner is started
        for turn in range(ROUNDS):
            bare.append(_round_trip(machine.redis.url))
            ours.append(_scans(service, 1, FRAMES, seed=1 + turn))
    return statistics.median(ours), statistics.median(bare)


def _many(machine: Servers) -> tuple[float, float]:
    """Seconds for each step and each task while many are in flight, on two slots."""
    bare: list[float] = []
    ours: list[float] = []
    settings = machine.settings("many_steps", TASKS).model_copy(update={"slots": 2})
    with bare_worker(machine.redis.url, 2), looking_at(settings) as service, worker_process(settings):
        _scans(service, 2, 4, seed=0)
        for turn in range(ROUNDS):
            bare.append(_flood(machine.redis.url))
            ours.append(_scans(service, IN_FLIGHT, FRAMES // 2, seed=10 + 10 * turn))
    return statistics.median(ours), statistics.median(bare)


@contextmanager
def bare_worker(broker: str, threads: int) -> Iterator[None]:
    """A Celery worker of so many threads while the block runs."""
    command = [sys.executable, "-m", "celery", "-A", "benchmarks.bare_celery", "worker", "-P", "threads"]
    command += ["-c", str(threads), "--without-gossip", "--without-mingle", "--without-heartbeat", "-l", "ERROR"]
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


def _flood(broker: str) -> float:
    """Seconds for each of many tasks that are sent at once."""
    os.environ["BARE_BROKER"] = broker
    from benchmarks.bare_celery import nothing

    began = time.perf_counter()
    ResultSet([nothing.delay(str(number)) for number in range(ROUND_TRIPS)]).join(timeout=60)
    return (time.perf_counter() - began) / ROUND_TRIPS


def _scans(service: Service, count: int, frames: int, *, seed: int) -> float:
    """Seconds per step from the first claim of the scans to the end of the last, by the database's clock."""
    ids = [service.submit(toy_spec(frames=frames, seed=seed + number)) for number in range(count)]
    assert {service.end_of(scan_id, 120).state for scan_id in ids} == {"succeeded"}
    with service.store.read() as session:
        took = select(func.max(Scan.finished_at) - func.min(Scan.started_at)).where(Scan.id.in_(ids))
        steps = select(func.count(Step.id)).where(Step.scan_id.in_(ids))
        return (session.scalars(took).one() or 0.0) / session.scalars(steps).one()


def _syncs(folder: Path) -> float:
    """Median seconds of what a step waits for the disk: a small file, the folder of its name, a page of a log."""
    took = []
    handle = os.open(folder, os.O_RDONLY)
    with (folder / "log").open("wb") as log:
        for number in range(SYNCS):
            began = time.perf_counter()
            with (folder / f"{number}.sync").open("wb") as file:
                file.write(b"x" * 100)
                file.flush()
                os.fsync(file.fileno())
            os.fsync(handle)
            log.write(b"x" * 8192)
            log.flush()
            os.fdatasync(log.fileno())
            took.append(time.perf_counter() - began)
    os.close(handle)
    return statistics.median(took)
