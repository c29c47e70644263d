"""Totals that every process tells alike: counted from rows, each once, and kept when the rows are deleted.

An attempt that has ended is added to the `meter` rows in the transaction that marks it `counted`, so it is counted
exactly once whoever does it, and no step pays for it while it ends. Gauges are counted from the rows as they are.
Histograms are kept as Prometheus reads them, but not cumulated: one total per edge, one sum.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from sqlalchemy import Row, func, select, tuple_, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from scanjobs.account_tables import WebhookDelivery, WebhookEndpoint
from scanjobs.clock import now_s
from scanjobs.messages import QUEUES
from scanjobs.states import LIVE_STEP_STATES, ScanState, StepState
from scanjobs.tables import Artifact, ArtifactRef, Attempt, Meter, Scan, Step, Worker

BATCH: Final = 500
"""Attempts added in one transaction."""
STEP_EDGES: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0)
LAG_EDGES: Final = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0)
BEYOND: Final = "+Inf"
DELIVERED_WITHIN_S: Final = 24 * 3600.0
"""A message to an endpoint is given up after so long."""
OUTCOMES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "succeeded": "succeeded",
        "failed": "failed",
        "lease expired": "lease_expired",
        "drain": "drained",
        "canceled": "canceled",
        "scan failed": "canceled",
    }
)
"""What an attempt's outcome is called among the totals; every other word is `other`."""
OPEN_SCAN_STATES: Final = (
    ScanState.UPLOADING,
    ScanState.QUEUED,
    ScanState.RUNNING,
    ScanState.PAUSED,
    ScanState.CANCELING,
)

Key = tuple[str, str]
"""A counter's name, and its labels as text."""


@dataclass(frozen=True, slots=True)
class Total:
    """One total with its labels."""

    name: str
    labels: Mapping[str, str]
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gauges:
    """What the rows say now; seconds by the database's clock."""

    steps: Mapping[tuple[str, str], int]
    """(queue, state) → how many."""
    oldest_ready_s: Mapping[str, float]
    """Queue → since when its oldest step waits to be claimed; 0 where none waits."""
    scans: Mapping[str, int]
    slots: Mapping[str, int]
    """Queue → slots of the workers that are alive and serve it."""
    workers: int
    overdue_leases: int
    oldest_webhook_s: float
    """Since when the oldest message to an endpoint that is enabled is to be delivered; 0 where none waits."""


@dataclass(slots=True)
class Tally:
    """What a batch adds to the totals."""

    sums: Counter[Key] = field(default_factory=Counter)

    def add(self, name: str, amount: float = 1.0, **labels: str) -> None:
        """Add to one total."""
        self.sums[name, as_text(labels)] += amount  # type: ignore[assignment]

    def observe(self, name: str, value: float, edges: Sequence[float], **labels: str) -> None:
        """Add to a histogram."""
        place = bisect_left(edges, value)
        edge = f"{edges[place]:g}" if place < len(edges) else BEYOND
        self.add(f"{name}_bucket", 1.0, **labels, le=edge)
        self.add(f"{name}_sum", value, **labels)


def fold(session: Session, most: int = BATCH) -> int:
    """Add at most so many attempts that have ended to the totals; returns how many it added."""
    attempts = _take(session, most)
    if not attempts:
        return 0
    ids = [attempt.step_id for attempt in attempts]
    steps = {row.id: row for row in session.execute(_STEPS.where(Step.id.in_(ids)))}
    sizes = _bytes_of(session, ids)
    tally = Tally()
    for attempt in attempts:
        _count(tally, attempt, steps[attempt.step_id], sizes.get(attempt.step_id, 0))
    add(session, tally.sums)
    return len(attempts)


def has_uncounted(session: Session) -> bool:
    """A look before the transaction of `fold`."""
    query = select(Attempt.step_id).where(~Attempt.counted, Attempt.ended_at.is_not(None)).limit(1)
    return session.scalars(query).first() is not None


def count_scan(session: Session, state: ScanState) -> None:
    """A scan has ended."""
    add(session, {("scans_ended", as_text({"state": state.value})): 1.0})


def add(session: Session, sums: Mapping[Key, float]) -> None:
    """Add to the totals, always in one order: two transactions never wait for each other in a ring."""
    dialect = postgresql if session.get_bind().dialect.name == "postgresql" else sqlite
    for (name, labels), amount in sorted(sums.items()):
        statement = dialect.insert(Meter).values(name=name, labels=labels, value=amount)
        grown = {"value": Meter.value + statement.excluded.value}
        session.execute(statement.on_conflict_do_update(index_elements=["name", "labels"], set_=grown))


def read_totals(session: Session) -> tuple[Total, ...]:
    """Every total, by name and labels."""
    query = select(Meter.name, Meter.labels, Meter.value).order_by(Meter.name, Meter.labels)
    return tuple(Total(name, _from_text(labels), value) for name, labels, value in session.execute(query))


def read_gauges(session: Session) -> Gauges:
    """What waits, runs and is overdue now; cheap, because only live rows are looked at."""
    workers = session.execute(select(Worker.queues, Worker.slots).where(Worker.lease_until > now_s())).all()
    slots = Counter(dict.fromkeys(QUEUES, 0))
    for queues, number in workers:
        slots.update(dict.fromkeys(queues.split(","), number))
    overdue = select(func.count()).where(Step.state == StepState.RUNNING, Step.lease_until < now_s())
    return Gauges(
        steps=_steps_by_queue(session),
        oldest_ready_s=_oldest_ready(session),
        scans=_open_scans(session),
        slots=slots,
        workers=len(workers),
        overdue_leases=session.scalars(overdue).one(),
        oldest_webhook_s=_oldest_webhook(session),
    )


def read_artifacts(session: Session) -> tuple[int, int]:
    """How many files the database knows, and their bytes; looks at every row."""
    number, size = session.execute(select(func.count(), func.coalesce(func.sum(Artifact.size), 0))).one()
    return int(number), int(size)


def as_text(labels: Mapping[str, str]) -> str:
    """`label=value,label=value`; neither holds a comma or an equals sign."""
    return ",".join(f"{label}={value}" for label, value in labels.items())


def _from_text(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split(",") if pair)


_STEPS: Final = select(Step.id, Step.kind, Step.queue, Step.ready_at, Step.facts)


def _take(session: Session, most: int) -> Sequence[Row]:
    """Mark a batch as counted and return it; a row that another process is counting is left to it."""
    ended = (~Attempt.counted, Attempt.ended_at.is_not(None))
    batch = select(Attempt.step_id, Attempt.token).where(*ended).limit(most).with_for_update(skip_locked=True)
    columns = (Attempt.step_id, Attempt.token, Attempt.started_at, Attempt.ended_at, Attempt.outcome)
    statement = update(Attempt).where(tuple_(Attempt.step_id, Attempt.token).in_(batch), ~Attempt.counted)
    statement = statement.values(counted=True).returning(*columns)
    return session.execute(statement, execution_options={"synchronize_session": False}).all()


def _count(tally: Tally, attempt: Row, step: Row, size: int) -> None:
    outcome = OUTCOMES.get(attempt.outcome or "", "other")
    tally.add("attempts", kind=step.kind, outcome=outcome)
    if attempt.token > 1:
        tally.add("retries", kind=step.kind)
    if outcome == "lease_expired":
        tally.add("lease_expiries", kind=step.kind)
    if step.ready_at is not None and attempt.started_at >= step.ready_at:
        tally.observe("dispatch_lag_seconds", attempt.started_at - step.ready_at, LAG_EDGES, queue=step.queue)
    seconds = max(0.0, attempt.ended_at - attempt.started_at)
    if outcome != "succeeded":
        tally.add("lost_seconds", seconds, kind=step.kind, outcome=outcome)
    else:
        tally.observe("step_seconds", seconds, STEP_EDGES, kind=step.kind)
        tally.add("artifact_bytes_written", size, kind=step.kind)
        tally.add("rays", float((step.facts or {}).get("rays", 0)))


def _bytes_of(session: Session, step_ids: Iterable[str]) -> dict[str, int]:
    query = (
        select(ArtifactRef.step_id, func.sum(Artifact.size))
        .join(Artifact, Artifact.digest == ArtifactRef.digest)
        .where(ArtifactRef.step_id.in_(list(step_ids)))
        .group_by(ArtifactRef.step_id)
    )
    return {row[0]: int(row[1]) for row in session.execute(query)}


def _steps_by_queue(session: Session) -> dict[tuple[str, str], int]:
    live = [state.value for state in LIVE_STEP_STATES]
    found = {(queue, state.value): 0 for queue in QUEUES for state in sorted(LIVE_STEP_STATES)}
    query = select(Step.queue, Step.state, func.count()).where(Step.state.in_(live)).group_by(Step.queue, Step.state)
    return found | {(row[0], row[1]): row[2] for row in session.execute(query)}


def _oldest_ready(session: Session) -> dict[str, float]:
    waiting = [StepState.READY.value, StepState.SENT.value]
    query = (
        select(Step.queue, now_s() - func.min(Step.ready_at))
        .where(Step.state.in_(waiting), Step.ready_at <= now_s())
        .group_by(Step.queue)
    )
    return dict.fromkeys(QUEUES, 0.0) | {row[0]: max(0.0, row[1] or 0.0) for row in session.execute(query)}


def _oldest_webhook(session: Session) -> float:
    query = (
        select(now_s() - func.min(WebhookDelivery.give_up_at) + DELIVERED_WITHIN_S)
        .join(WebhookEndpoint, WebhookEndpoint.id == WebhookDelivery.endpoint_id)
        .where(WebhookDelivery.state == "waiting", WebhookEndpoint.enabled)
    )
    return max(0.0, session.scalars(query).one() or 0.0)


def _open_scans(session: Session) -> dict[str, int]:
    states = [state.value for state in OPEN_SCAN_STATES]
    query = select(Scan.state, func.count()).where(Scan.state.in_(states)).group_by(Scan.state)
    return dict.fromkeys(states, 0) | {row[0]: row[1] for row in session.execute(query)}
