"""Telling others what happens: endpoints, and an outbox in SQL of what each is still to be told.

A delivery is written in the transaction that makes what it tells of, so it exists if and only if that happened. It is
sent at least once: claimed with a token, tried again with growing pauses for a day, its every attempt written down.
Messages and signatures are those of Standard Webhooks (https://www.standardwebhooks.com).
"""

import base64
import random
import secrets
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from sqlalchemy import delete, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.account_tables import WebhookAttempt, WebhookDelivery, WebhookEndpoint
from scanjobs.clock import now_s
from scanjobs.errors import NotFound
from scanjobs.meters import DELIVERED_WITHIN_S, add, as_text
from scanjobs.states import ScanState
from scanjobs.table_base import table_of
from scanjobs.tables import Scan
from scanjobs.uuids import new_id

WAITING: Final = "waiting"
DELIVERED: Final = "delivered"
GIVEN_UP: Final = "given_up"
DAY_S: Final = DELIVERED_WITHIN_S
KEPT_S: Final = 30 * DAY_S
FIRST_PAUSE_S: Final = 5.0
LONGEST_PAUSE_S: Final = 2 * 3600.0
SENDING_S: Final = 60.0
"""A delivery that was claimed and not heard of again is anybody's after this long."""
AT_ONCE: Final = 4
"""Deliveries of one endpoint under way at the same time in one process."""
TOLD: Final[frozenset[ScanState]] = frozenset(
    {ScanState.QUEUED, ScanState.RUNNING, ScanState.PAUSED, ScanState.SUCCEEDED, ScanState.FAILED, ScanState.CANCELED}
)
TEST_TYPE: Final = "webhook.test"
MEANING: Final[Mapping[str, str]] = {
    "alarm.opened": "a plant is not as it should be",
    "alarm.acknowledged": "somebody has seen to it",
    "alarm.closed": "it is over",
    "scan.queued": "a scan is to run again",
    "scan.running": "its first step has begun",
    "scan.paused": "no step of it begins",
    "scan.succeeded": "its modes are there",
    "scan.failed": "it ended without modes",
    "scan.canceled": "somebody has stopped it",
}
"""What each kind of message says has happened."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claimed:
    """The right to send one delivery once."""

    id: str
    token: int
    number: int
    url: str
    secrets: tuple[str, ...]
    payload: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of an attempt: a status, or the reason why there is none."""

    took_s: float
    status: int | None = None
    error: str | None = None
    answer: str = ""
    retry_after_s: float | None = None

    @property
    def is_good(self) -> bool:
        """Whether the endpoint took the message."""
        return self.status is not None and 200 <= self.status < 300

    @property
    def word(self) -> str:
        """What the attempt is called among the totals."""
        return "delivered" if self.is_good else "unreachable" if self.status is None else "refused"


def new_secret() -> str:
    """A signing secret as Standard Webhooks writes it: 256 bits."""
    return "whsec_" + base64.b64encode(secrets.token_bytes(32)).decode()


def add_endpoint(
    session: Session, *, owner: str, url: str, types: Collection[str] = (), description: str = ""
) -> WebhookEndpoint:
    """Remember an address that was judged; its secret is shown by whoever asked for it, once."""
    endpoint_id = new_id()
    values = {
        "id": endpoint_id,
        "owner": owner,
        "url": url,
        "description": description,
        "types": sorted(set(types)),
        "secret": new_secret(),
        "enabled": True,
        "created_at": now_s(),
    }
    session.execute(insert(WebhookEndpoint).values(values))
    return get_endpoint(session, endpoint_id, owner=owner)


def get_endpoint(session: Session, endpoint_id: str, *, owner: str) -> WebhookEndpoint:
    """An owner's endpoint. Raises `NotFound`."""
    mine = (WebhookEndpoint.id == endpoint_id, WebhookEndpoint.owner == owner)
    endpoint = session.scalars(select(WebhookEndpoint).where(*mine)).one_or_none()
    if endpoint is None:
        raise NotFound(f"there is no webhook {endpoint_id}.", hint="List yours with GET /v1/webhooks.")
    return endpoint


def list_endpoints(session: Session, *, owner: str) -> tuple[WebhookEndpoint, ...]:
    """An owner's endpoints, the newest first."""
    query = select(WebhookEndpoint).where(WebhookEndpoint.owner == owner)
    return tuple(session.scalars(query.order_by(WebhookEndpoint.id.desc())))


def change_endpoint(session: Session, endpoint_id: str, values: dict[str, Any], *, owner: str) -> WebhookEndpoint:
    """Change some columns of an endpoint. Raises `NotFound`."""
    endpoint = get_endpoint(session, endpoint_id, owner=owner)
    if values:
        session.execute(update(WebhookEndpoint).where(WebhookEndpoint.id == endpoint.id).values(values))
        session.refresh(endpoint)
    return endpoint


def rotate_secret(session: Session, endpoint_id: str, *, owner: str, grace_s: float) -> WebhookEndpoint:
    """A new secret; for `grace_s` seconds messages carry the signature of the old one too. Raises `NotFound`."""
    endpoint = get_endpoint(session, endpoint_id, owner=owner)
    values = {"secret": new_secret(), "old_secret": endpoint.secret, "old_secret_until": now_s() + grace_s}
    return change_endpoint(session, endpoint_id, values, owner=owner)


def remove_endpoint(session: Session, endpoint_id: str, *, owner: str) -> None:
    """Forget an endpoint with its deliveries. Raises `NotFound`."""
    endpoint = get_endpoint(session, endpoint_id, owner=owner)
    session.execute(delete(WebhookEndpoint).where(WebhookEndpoint.id == endpoint.id))


def announce_scan(session: Session, scan: Scan) -> None:
    """Write down, in the transaction that moved the scan, whom its new state is to be told."""
    if ScanState(scan.state) not in TOLD:
        return
    data = {
        "scan": scan.id,
        "name": scan.name,
        "state": scan.state,
        "plant": scan.plant,
        "generation": scan.generation,
        "error": scan.error,
        "href": f"/v1/scans/{scan.id}",
    }
    announce(session, owner=scan.owner, kind=f"scan.{scan.state}", data=data)


def announce(session: Session, *, owner: str, kind: str, data: dict[str, Any]) -> int:
    """Write down a message for every endpoint of the owner that wants its kind; returns how many."""
    query = select(WebhookEndpoint).where(WebhookEndpoint.owner == owner, WebhookEndpoint.enabled)
    wanted = [one for one in session.scalars(query) if not one.types or kind in one.types]
    for endpoint in wanted:
        enqueue(session, endpoint, kind=kind, data=data)
    return len(wanted)


def enqueue(session: Session, endpoint: WebhookEndpoint, *, kind: str, data: dict[str, Any]) -> str:
    """Write down one message for one endpoint; returns its id."""
    delivery_id = new_id()
    payload = {"type": kind, "timestamp": datetime.now(UTC).isoformat(), "data": data}
    values = {
        "id": delivery_id,
        "endpoint_id": endpoint.id,
        "type": kind,
        "payload": payload,
        "state": WAITING,
        "attempts": 0,
        "token": 0,
    }
    times = {"next_at": now_s(), "give_up_at": now_s() + DAY_S, "created_at": now_s()}
    session.execute(insert(WebhookDelivery).values(values | times))
    return delivery_id


def claim_due(session: Session, most: int = 20) -> tuple[Claimed, ...]:
    """Take what is due, a few of each endpoint, so that one that does not answer holds up no other."""
    query = (
        select(WebhookDelivery, WebhookEndpoint)
        .join(WebhookEndpoint, WebhookEndpoint.id == WebhookDelivery.endpoint_id)
        .where(WebhookDelivery.state == WAITING, WebhookDelivery.next_at <= now_s(), WebhookEndpoint.enabled)
        .order_by(WebhookDelivery.next_at)
        .limit(most * 10)
    )
    now = session.scalars(select(now_s())).one()
    taken: list[Claimed] = []
    per_endpoint: dict[str, int] = {}
    for delivery, endpoint in session.execute(query).all():
        if len(taken) == most:
            break
        if per_endpoint.get(endpoint.id, 0) < AT_ONCE and _take(session, delivery):
            per_endpoint[endpoint.id] = per_endpoint.get(endpoint.id, 0) + 1
            taken.append(_claimed(delivery, endpoint, now))
    return tuple(taken)


def record(session: Session, claimed: Claimed, outcome: Outcome) -> bool:
    """Write an attempt down, and what follows from it; False when the claim is lost."""
    row = session.execute(
        select(WebhookDelivery.give_up_at, now_s())
        .where(WebhookDelivery.id == claimed.id, WebhookDelivery.token == claimed.token)
        .with_for_update()
    ).one_or_none()
    if row is None:
        return False
    session.execute(insert(table_of(WebhookAttempt)).values(_attempt(claimed, outcome) | {"at": now_s()}))
    add(session, {("webhook_attempts", as_text({"outcome": outcome.word})): 1.0})
    next_at = row[1] + pause_s(claimed.number, outcome.retry_after_s)
    values: dict[str, Any] = {"attempts": claimed.number, "next_at": next_at}
    if outcome.is_good:
        values |= {"state": DELIVERED, "delivered_at": now_s()}
    elif next_at > row[0] or outcome.status == 410:
        values |= {"state": GIVEN_UP}
    session.execute(update(WebhookDelivery).where(WebhookDelivery.id == claimed.id).values(values))
    if outcome.status == 410:  # Gone: Standard Webhooks asks to stop
        of_delivery = select(WebhookDelivery.endpoint_id).where(WebhookDelivery.id == claimed.id).scalar_subquery()
        session.execute(update(WebhookEndpoint).where(WebhookEndpoint.id == of_delivery).values(enabled=False))
    return True


def pause_s(number: int, asked_s: float | None = None, chance: float | None = None) -> float:
    """Seconds from attempt `number` (from 1) to the next: doubling up to two hours, a fifth of it by chance."""
    chance = random.random() if chance is None else chance
    pause = min(FIRST_PAUSE_S * 2 ** min(number - 1, 20), LONGEST_PAUSE_S) * (0.9 + 0.2 * chance)
    return max(pause, min(asked_s or 0.0, LONGEST_PAUSE_S))


def list_deliveries(
    session: Session,
    endpoint: WebhookEndpoint,
    *,
    state: str | None = None,
    before: str | None = None,
    limit: int = 50,
) -> tuple[WebhookDelivery, ...]:
    """What an endpoint was told or is to be told, the newest first; in one state if given."""
    query = select(WebhookDelivery).where(WebhookDelivery.endpoint_id == endpoint.id)
    if state is not None:
        query = query.where(WebhookDelivery.state == state)
    if before is not None:
        query = query.where(WebhookDelivery.id < before)
    return tuple(session.scalars(query.order_by(WebhookDelivery.id.desc()).limit(limit)))


def get_delivery(session: Session, endpoint: WebhookEndpoint, delivery_id: str) -> WebhookDelivery:
    """One delivery of an endpoint. Raises `NotFound`."""
    mine = (WebhookDelivery.id == delivery_id, WebhookDelivery.endpoint_id == endpoint.id)
    found = session.scalars(select(WebhookDelivery).where(*mine)).one_or_none()
    if found is None:
        raise NotFound(f"there is no delivery {delivery_id}.", hint="List them with GET /v1/webhooks/{id}/deliveries.")
    return found


def attempts_of(session: Session, delivery: WebhookDelivery) -> tuple[WebhookAttempt, ...]:
    """Every attempt to deliver, the first one first."""
    query = select(WebhookAttempt).where(WebhookAttempt.delivery_id == delivery.id)
    return tuple(session.scalars(query.order_by(WebhookAttempt.number)))


def replay(session: Session, endpoint: WebhookEndpoint, delivery_id: str) -> WebhookDelivery:
    """Send a delivery again, with the same id, for another day. Raises `NotFound`."""
    delivery = get_delivery(session, endpoint, delivery_id)
    values = {"state": WAITING, "next_at": now_s(), "give_up_at": now_s() + DAY_S, "delivered_at": None}
    session.execute(update(WebhookDelivery).where(WebhookDelivery.id == delivery.id).values(values))
    session.refresh(delivery)
    return delivery


def remove_old(session: Session) -> int:
    """Forget what ended longer than a month ago; returns how many."""
    old = (WebhookDelivery.state != WAITING, WebhookDelivery.created_at < now_s() - KEPT_S)
    return len(session.scalars(delete(WebhookDelivery).where(*old).returning(WebhookDelivery.id)).all())


def _take(session: Session, delivery: WebhookDelivery) -> bool:
    mine = (
        WebhookDelivery.id == delivery.id,
        WebhookDelivery.token == delivery.token,
        WebhookDelivery.state == WAITING,
    )
    values = {"token": delivery.token + 1, "next_at": now_s() + SENDING_S}
    took = update(WebhookDelivery).where(*mine).values(values).returning(WebhookDelivery.id)
    return session.execute(took, execution_options={"synchronize_session": False}).one_or_none() is not None


def _claimed(delivery: WebhookDelivery, endpoint: WebhookEndpoint, now: float) -> Claimed:
    old = endpoint.old_secret if endpoint.old_secret and (endpoint.old_secret_until or 0) > now else None
    return Claimed(
        id=delivery.id,
        token=delivery.token + 1,
        number=delivery.attempts + 1,
        url=endpoint.url,
        secrets=(endpoint.secret,) if old is None else (endpoint.secret, old),
        payload=delivery.payload,
    )


def _attempt(claimed: Claimed, outcome: Outcome) -> dict[str, Any]:
    return {
        "delivery_id": claimed.id,
        "number": claimed.number,
        "took_s": outcome.took_s,
        "status": outcome.status,
        "error": None if outcome.error is None else outcome.error[:255],
        "answer": outcome.answer[:200].replace("\x00", ""),
    }
