"""Random kills under simulated work: what is lost, what is doubled, and what every recovery costs.

    python -m benchmarks.chaos [--kills 1000] [--minutes 30] [--stack]

Toy steps (CPU burnt, a file written) run on worker processes while one process after the other is killed with -9 or
frozen: runners, workers, and all workers at once. Whatever was killed is replaced. New scans keep the queue full until
the kills are done; then everything must end. A lost step is one of a finished scan that has not succeeded; a doubled
one has more than one accepted attempt, or a scan has more than one accepted identification. `fsck` has the last word.
"""

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from scanjobs.clock import now_s
from scanjobs.messages import IDENTIFY
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings
from scanjobs.states import TERMINAL_SCAN_STATES, StepState
from scanjobs.tables import Attempt, Scan, Step
from sqlalchemy import and_, func, or_, select

from tests.faults.steps import freeze
from tests.integration.toy_service import Service, WorkerProcess, looking_at, toy_settings, toy_spec
from tests.stack.servers import Postgres, Redis

FOLDER = Path("out/benchmarks")
FATES = ("runner",) * 15 + ("worker",) * 5 + ("freeze", "everybody")
"""What is done to whom, by its share."""
AT_ONCE = 3
"""Scans under way."""
FRAMES = 12


@dataclass
class Toll:
    """What was done, and how long it took to go on."""

    kills: Counter[str] = field(default_factory=Counter)
    recoveries: list[float] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Kills of every sort."""
        return sum(self.kills.values())


class Crew:
    """Workers that are killed and replaced."""

    def __init__(self, settings: Settings, count: int, chance: random.Random) -> None:
        self._settings = settings
        self._chance = chance
        self._hired = [WorkerProcess(settings) for _ in range(count)]

    def suffer(self, service: Service, toll: Toll) -> None:
        """One fate for somebody."""
        fate = self._chance.choice(FATES)
        if fate == "runner":
            self._kill_runner(service, toll)
        elif fate == "worker":
            self._replace([self._chance.randrange(len(self._hired))], toll)
        elif fate == "everybody":
            self._replace(range(len(self._hired)), toll)
        else:
            self._freeze(service, toll)

    def close(self) -> None:
        """Kill them all."""
        for worker in self._hired:
            worker.close()

    def _kill_runner(self, service: Service, toll: Toll) -> None:
        running = sorted(service.runners().values())
        if running:
            with suppress(ProcessLookupError):
                os.kill(self._chance.choice(running), signal.SIGKILL)
                toll.kills["runner"] += 1

    def _replace(self, positions: Sequence[int], toll: Toll) -> None:
        for position in positions:
            self._hired[position].close()
            toll.kills["worker"] += 1
        for position in positions:
            self._hired[position] = WorkerProcess(self._settings)

    def _freeze(self, service: Service, toll: Toll) -> None:
        worker = self._chance.choice(self._hired)
        freeze(worker, service)
        time.sleep(self._chance.choice([0.3, 1.3]) * self._settings.lease_s)
        worker.signal(signal.SIGCONT)
        toll.kills["freeze"] += 1


def torment(service: Service, crew: Crew, chance: random.Random, kills: int, minutes: float) -> Toll:
    """Kill until there were so many kills, or so many minutes have passed."""
    toll, deadline, told = Toll(), time.monotonic() + 60 * minutes, 0
    seed = 0
    while toll.total < kills and time.monotonic() < deadline:
        while open_scans(service) < AT_ONCE:
            service.submit(toy_spec(frames=FRAMES, seed=seed))
            seed += 1
        crew.suffer(service, toll)
        toll.recoveries.append(wait_for_work(service))
        time.sleep(chance.uniform(0.0, 0.2))
        if toll.total >= told + 100:
            told = toll.total
            print(f"{toll.total} kills, {seed} scans begun", flush=True)
    return toll


def wait_for_work(service: Service) -> float:
    """Seconds until some step is computed again, or none is due: steps that failed often pause for up to 30 s."""
    began = time.monotonic()
    service.wait(lambda: bool(service.runners()) or not is_work_due(service), 120)
    return time.monotonic() - began


def is_work_due(service: Service) -> bool:
    """Whether some step could be computed now, or a plan is to be written."""
    unpaused = or_(Step.not_before.is_(None), Step.not_before <= now_s())
    due = or_(Step.state.in_([StepState.SENT, StepState.RUNNING]), and_(Step.state == StepState.READY, unpaused))
    with service.store.read() as session:
        unplanted = select(Scan.id).where(Scan.unplanted_from.is_not(None))
        return any(session.scalars(query.limit(1)).first() for query in (select(Step.id).where(due), unplanted))


def open_scans(service: Service) -> int:
    """Scans that have not ended."""
    query = select(func.count()).select_from(Scan)
    with service.store.read() as session:
        return session.scalars(query.where(Scan.state.not_in([state.value for state in TERMINAL_SCAN_STATES]))).one()


def lost_steps(service: Service) -> int:
    """Steps that have not succeeded, when every scan has ended."""
    with service.store.read() as session:
        return session.scalars(select(func.count()).select_from(Step).where(Step.state != StepState.SUCCEEDED)).one()


def doubled_steps(service: Service) -> int:
    """Steps accepted more than once, and identifications beyond one a generation."""
    accepted = select(Attempt.step_id).where(Attempt.outcome == "succeeded").group_by(Attempt.step_id)
    identified = (
        select(Step.scan_id)
        .where(Step.kind == IDENTIFY, Step.frame == -1, Step.state == StepState.SUCCEEDED)
        .group_by(Step.scan_id, Step.generation)
    )
    with service.store.read() as session:
        twice = session.scalars(accepted.having(func.count() > 1)).all()
        again = session.scalars(identified.having(func.count() > 1)).all()
    return len(twice) + len(again)


def main() -> int:
    """Run, print the table, write it; 1 when a floor is missed."""
    arguments = parse()
    chance = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory(prefix="nerfmodal-chaos-") as folder, servers(arguments.stack) as urls:
        settings = settings_of(Path(folder), urls)
        upgrade(settings.database)
        with looking_at(settings) as service:
            rows = measure(service, settings, chance, arguments)
    report(rows, FOLDER / ("chaos_stack.json" if arguments.stack else "chaos.json"))
    return 0 if all(row["value"] == row["floor"] for row in rows if row["floor"] is not None) else 1


def measure(
    service: Service, settings: Settings, chance: random.Random, arguments: argparse.Namespace
) -> list[dict[str, object]]:
    """The table's rows."""
    began = time.monotonic()
    crew = Crew(settings, arguments.workers, chance)
    try:
        toll = torment(service, crew, chance, arguments.kills, arguments.minutes)
        service.wait(lambda: not open_scans(service), 300)
    finally:
        crew.close()
    with service.store.read() as session:
        scans = session.scalars(select(func.count()).select_from(Scan)).one()
        steps = session.scalars(select(func.count()).select_from(Step)).one()
        claims = session.scalars(select(func.count()).select_from(Attempt)).one()
    where = f"{service.store.dialect}, {settings.broker_url.partition(':')[0]}"
    slowest = max(toll.recoveries)
    return [
        row(f"lost steps ({where})", lost_steps(service), "steps", 0, 0),
        row(f"doubled steps ({where})", doubled_steps(service), "steps", 0, 0),
        row(f"violations that fsck finds ({where})", len(service.violations()), "", 0, 0),
        row("kills", toll.total, "", None, 1000),
        *(row(f"kills: {fate}", count, "", None, None) for fate, count in sorted(toll.kills.items())),
        row("scans", scans, "", None, None),
        row("steps", steps, "", None, None),
        row("claims for each step", claims / steps, "", None, None),
        row("until work goes on, median", median(toll.recoveries), "s", None, None),
        row("until work goes on, slowest", slowest, "s", None, settings.lease_s + 5),
        row("whole run", time.monotonic() - began, "s", None, None),
    ]


def row(what: str, value: float, unit: str, floor: float | None, aim: float | None) -> dict[str, object]:
    """One line of the table."""
    return {"what": what, "value": round(value, 3), "unit": unit, "floor": floor, "aim": aim}


def report(rows: Sequence[dict[str, object]], out: Path) -> None:
    """Print and write."""
    for one in rows:
        wanted = "" if one["floor"] is None else f"  (at most {one['floor']})"
        print(f"{one['what']!s:50} {one['value']!s:>10} {one['unit']}{wanted}")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(rows, indent=1))


@contextmanager
def servers(is_stack: bool) -> Iterator[dict[str, str]]:
    """A PostgreSQL and a Redis of the benchmark's own, as settings; or nothing, which is SQLite and memory."""
    if not is_stack:
        yield {}
        return
    postgres, redis = Postgres(), Redis()
    try:
        postgres.start()
        redis.start()
        yield {"database_url": postgres.url, "broker_url": redis.url}
    finally:
        redis.stop()
        postgres.stop()
        postgres.remove()


def settings_of(folder: Path, urls: dict[str, str]) -> Settings:
    """Short leases, and attempts enough for any number of kills."""
    quick = {"lease_s": 2.0, "max_attempts": 1000, "resend_s": 2.0}
    return toy_settings(folder).model_copy(update={**urls, **quick})


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=60.0, help="give up after so many minutes")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--stack", action="store_true", help="on PostgreSQL and Redis instead of SQLite and memory")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
