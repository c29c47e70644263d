"""Ready steps become sent ones: a small window per queue, so that the broker's order never matters.

At most twice the free slots of a queue are `sent`. Of what is ready comes first: the higher priority, the owner with
the fewest steps under way for its weight, the scan that has had little so far (by powers of two, and by a level less
for each minute that it waits, so that nobody waits for ever), the scan with the fewest steps under way, the deepest
step (a frame under way is finished before another is begun), the oldest. The caller publishes the messages after the
commit; a message that is lost is sent again.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

from sqlalchemy import Double, Select, and_, bindparam, func, or_, select
from sqlalchemy.orm import Session

from scanjobs.account_tables import Owner
from scanjobs.clock import now_s
from scanjobs.messages import Message
from scanjobs.states import WORKING_SCAN_STATES, StepState
from scanjobs.store import one_at_a_time
from scanjobs.tables import Scan, Step, table_of
from scanjobs.transitions import move_step
from scanjobs.workers import active_workers

WINDOW: Final = 2
"""Messages waiting for each free slot."""

NEVER_S: Final = 1e12

LEVEL_S: Final = 60.0
"""Waiting so long without a single step lowers a scan by one level."""

DISPATCHING: Final = 1
"""Names the lock: two dispatchers at once would each fill the whole window."""
UNHELD: Final = MappingProxyType({"worker_id": None})


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A ready step, with what decides about its turn."""

    step_id: str
    queue: str
    scan_id: str
    owner: str
    priority: int
    depth: int
    frame: int
    weight: float = 1.0
    """Of the owner: twice the weight is twice the share."""
    level: int = 0
    """Of the scan: how much it has had (`level_of`)."""
    token: int = 0
    state: StepState = StepState.READY


@dataclass(slots=True)
class Room:
    """How many steps each queue may still be sent; workers that serve several queues share their slots."""

    queue_left: dict[str, int]
    pool_of: dict[str, str]
    pool_left: dict[str, int]

    def is_left(self) -> bool:
        """Whether any pool may still be sent a step."""
        return any(left > 0 for left in self.pool_left.values())

    def take(self, queue: str) -> bool:
        """Use one place of a queue if there is one."""
        pool = self.pool_of.get(queue)
        if pool is None or self.queue_left[queue] <= 0 or self.pool_left[pool] <= 0:
            return False
        self.queue_left[queue] -= 1
        self.pool_left[pool] -= 1
        return True


@dataclass(slots=True)
class Load:
    """Steps sent or running, by owner and by scan."""

    owners: Counter[str] = field(default_factory=Counter)
    scans: Counter[str] = field(default_factory=Counter)


def dispatch(session: Session, holder: str | None = None) -> tuple[Message, ...]:
    """Move to `sent` what there is room for; the messages are to be published after the commit.

    `holder` is the worker in whose memory the messages will lie, where the broker has no other place for them.
    """
    one_at_a_time(session, DISPATCHING)
    room = _room(session)
    if not room.is_left():
        return ()
    open_queues = [queue for queue, left in room.queue_left.items() if left > 0]
    waiting = candidates(session, open_queues, max(room.pool_left.values()))
    chosen = choose(waiting, room, load_of(session))
    return tuple(message for step_id in chosen if (message := _send(session, step_id, holder)) is not None)


def unclaimed_steps(session: Session, resend_s: float) -> tuple[str, ...]:
    """Sent steps that nobody claimed in `resend_s`: their message is lost, or its worker."""
    query = select(Step.id).where(Step.state == StepState.SENT, Step.sent_at < now_s() - resend_s)
    return tuple(session.scalars(query.order_by(Step.id)))


def take_back(session: Session, step_id: str) -> bool:
    """Nobody will take the sent step: it is ready to be sent again."""
    step = session.get(Step, step_id, populate_existing=True)
    if step is None or step.state != StepState.SENT:
        return False
    return move_step(session, step, StepState.READY, reason="unclaimed", values=UNHELD)


def is_sent(session: Session, step_id: str) -> bool:
    """Whether a message about this step is worth a claim."""
    return session.scalars(select(Step.state).where(Step.id == step_id)).one_or_none() == StepState.SENT


def choose(candidates: Iterable[Candidate], room: Room, load: Load) -> tuple[str, ...]:
    """The steps to send, in order; `room` and `load` are used up as they are chosen. Pure."""
    waiting = list(candidates)
    chosen: list[str] = []
    while waiting and room.is_left():
        best = min(waiting, key=lambda step: turn_of(step, load))
        waiting.remove(best)
        if room.take(best.queue):
            chosen.append(best.step_id)
            load.owners[best.owner] += 1
            load.scans[best.scan_id] += 1
    return tuple(chosen)


def level_of(served: int, waited_s: float) -> int:
    """The level of a scan of which so many steps were claimed, the last so many seconds ago. Pure."""
    return max(0, (served + 1).bit_length() - 1 - int(waited_s / LEVEL_S))


def turn_of(step: Candidate, load: Load) -> tuple[int, float, int, int, int, str, int, str]:
    """What the steps are ordered by. Pure."""
    return (
        -step.priority,
        load.owners[step.owner] / step.weight,
        step.level,
        load.scans[step.scan_id],
        -step.depth,
        step.scan_id,
        step.frame,
        step.step_id,
    )


def _send(session: Session, step_id: str, holder: str | None) -> Message | None:
    step = session.get(Step, step_id, populate_existing=True)
    if step is None or step.state != StepState.READY:
        return None
    sent = move_step(
        session, step, StepState.SENT, values={"sent_at": now_s(), "not_before": None, "worker_id": holder}
    )
    return Message(step.kind, step.queue, step.id) if sent else None


def _room(session: Session) -> Room:
    workers = active_workers(session)
    running = _count_by_queue(session, StepState.RUNNING)
    sent = _count_by_queue(session, StepState.SENT)
    return room_of([(set(worker.queues.split(",")), worker.slots) for worker in workers], running, sent)


def room_of(workers: Sequence[tuple[set[str], int]], running: Counter[str], sent: Counter[str]) -> Room:
    """Room in every queue, from the workers' (queues, slots) and what is under way. Pure."""
    pool_of = _pools([queues for queues, _ in workers])
    slots_of_queue: Counter[str] = Counter()
    slots_of_pool: Counter[str] = Counter()
    for queues, slots in workers:
        slots_of_pool[pool_of[min(queues)]] += slots
        slots_of_queue.update(dict.fromkeys(queues, slots))
    busy: Counter[str] = Counter()
    waiting: Counter[str] = Counter()
    for queue, pool in pool_of.items():
        busy[pool] += running[queue]
        waiting[pool] += sent[queue]
    free = {pool: max(0, slots - busy[pool]) for pool, slots in slots_of_pool.items()}
    queue_left = {
        queue: WINDOW * min(slots, free[pool_of[queue]]) - sent[queue] for queue, slots in slots_of_queue.items()
    }
    return Room(queue_left, pool_of, {pool: WINDOW * free[pool] - waiting[pool] for pool in free})


def _pools(groups: Sequence[set[str]]) -> dict[str, str]:
    """Queues that are linked by a worker serving both, under the name of the first of them."""
    pools: list[set[str]] = []
    for group in groups:
        linked = [pool for pool in pools if pool & group]
        pools = [pool for pool in pools if not pool & group] + [set(group).union(*linked)]
    return {queue: min(pool) for pool in pools for queue in pool}


def _count_by_queue(session: Session, state: StepState) -> Counter[str]:
    query = select(Step.queue, func.count()).where(Step.state == state).group_by(Step.queue)
    return Counter({row[0]: row[1] for row in session.execute(query)})


def load_of(session: Session) -> Load:
    """What is sent or running now."""
    query = (
        select(Scan.owner, Scan.id, func.count())
        .join(Step, Step.scan_id == Scan.id)
        .where(Step.state.in_([StepState.SENT, StepState.RUNNING]))
        .group_by(Scan.owner, Scan.id)
    )
    load = Load()
    for owner, scan_id, count in session.execute(query):
        load.owners[owner] += count
        load.scans[scan_id] += count
    return load


def candidates(
    session: Session, queues: Collection[str], most: int, *, unheard_s: float | None = None
) -> list[Candidate]:
    """The few steps (`most`) of every scan and queue that could be next.

    With `unheard_s` also those whose message nobody has heard for so long, since every slot is busy.
    """
    rows = session.execute(_QUERY, {"queues": list(queues), "most": most, "unheard_s": unheard_s or NEVER_S})
    return [
        Candidate(
            step_id=row.id,
            queue=row.queue,
            scan_id=row.scan_id,
            owner=row.owner,
            priority=row.priority,
            depth=row.depth,
            frame=row.frame,
            weight=row.weight,
            level=level_of(row.served, row.waited_s),
            token=row.token,
            state=StepState(row.state),
        )
        for row in rows
    ]


def _make_query() -> Select[Any]:
    """Written once: putting it together costs as much as asking it."""
    step, scan, owner = (table_of(entity).c for entity in (Step, Scan, Owner))  # no objects, no price of theirs
    place = func.row_number().over(
        partition_by=(step.scan_id, step.queue), order_by=(step.depth.desc(), step.frame, step.id)
    )
    unheard = and_(step.state == StepState.SENT, step.sent_at < now_s() - bindparam("unheard_s", type_=Double))
    waits = and_(step.state == StepState.READY, or_(step.not_before.is_(None), step.not_before <= now_s()))
    live = step.state.in_([StepState.READY.value, StepState.SENT.value])  # says to the planner which index
    working = scan.state.in_([state.value for state in WORKING_SCAN_STATES])
    ready = (
        select(step.id, step.queue, step.depth, step.frame, step.token, step.state)
        .add_columns(scan.id.label("scan_id"), scan.owner, scan.priority, scan.served)
        .add_columns(place.label("place"), func.coalesce(owner.weight, 1.0).label("weight"))
        .add_columns((now_s() - func.coalesce(scan.served_at, scan.created_at)).label("waited_s"))
        .join_from(table_of(Step), table_of(Scan), scan.id == step.scan_id)
        .outerjoin(table_of(Owner), owner.id == scan.owner)
        .where(live, or_(waits, unheard), working, step.queue.in_(bindparam("queues", expanding=True)))
        .subquery()
    )
    return select(ready).where(ready.c.place <= bindparam("most"))


_QUERY: Final = _make_query()
