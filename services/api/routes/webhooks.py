"""Webhooks: who is told what happens, what became of every message, and messages sent again."""

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response
from scanjobs.addresses import judge
from scanjobs.webhooks import (
    TEST_TYPE,
    add_endpoint,
    attempts_of,
    change_endpoint,
    enqueue,
    get_delivery,
    get_endpoint,
    list_deliveries,
    list_endpoints,
    remove_endpoint,
    replay,
    rotate_secret,
)
from sqlalchemy.orm import Session

from services.api.dependencies import Owner, Parts, Submitter, TheParts, uuid_of
from services.api.mail import is_mail, refuse_unmailable
from services.api.schemas_webhooks import (
    DeliveryDetail,
    DeliveryLog,
    DeliveryPage,
    DeliveryState,
    NewWebhook,
    NewWebhookRequest,
    SecretRotation,
    WebhookChange,
    WebhookDetail,
    WebhookList,
)

WHERE = "GET /v1/webhooks"
WebhookId = Annotated[str, Path(description="Id of a webhook.")]
DeliveryId = Annotated[str, Path(description="Id of a delivery.")]
router = APIRouter(prefix="/v1/webhooks", tags=["webhooks"])


@router.post("", status_code=201)
def create(asked: NewWebhookRequest, parts: TheParts, owner: Submitter, response: Response) -> NewWebhook:
    """Have an address told what happens. Its signing secret is in this answer and nowhere else."""
    _refuse_unreachable(parts, asked.url)
    endpoint = parts.store.write(
        lambda session: add_endpoint(
            session, owner=owner, url=asked.url, types=asked.types, description=asked.description
        )
    )
    response.headers["Location"] = f"/v1/webhooks/{endpoint.id}"
    return NewWebhook.of(endpoint)


@router.get("")
def list_(parts: TheParts, owner: Owner) -> WebhookList:
    """Every webhook, without secrets."""
    with parts.store.read() as session:
        return WebhookList(items=[WebhookDetail.of(row) for row in list_endpoints(session, owner=owner)])


@router.get("/{webhook_id}")
def show(webhook_id: WebhookId, parts: TheParts, owner: Owner) -> WebhookDetail:
    """One webhook."""
    with parts.store.read() as session:
        return WebhookDetail.of(get_endpoint(session, uuid_of(webhook_id, "webhook", WHERE), owner=owner))


@router.patch("/{webhook_id}")
def change(webhook_id: WebhookId, asked: WebhookChange, parts: TheParts, owner: Submitter) -> WebhookDetail:
    """Change what is given."""
    which = uuid_of(webhook_id, "webhook", WHERE)
    if asked.url is not None:
        _refuse_unreachable(parts, asked.url)
    values = asked.model_dump(exclude_none=True)
    return WebhookDetail.of(parts.store.write(lambda session: change_endpoint(session, which, values, owner=owner)))


@router.delete("/{webhook_id}", status_code=204)
def delete(webhook_id: WebhookId, parts: TheParts, owner: Submitter) -> None:
    """Tell this address nothing more; what it was told is forgotten."""
    which = uuid_of(webhook_id, "webhook", WHERE)
    parts.store.write(lambda session: remove_endpoint(session, which, owner=owner))


@router.post("/{webhook_id}/rotate-secret")
def rotate(webhook_id: WebhookId, asked: SecretRotation, parts: TheParts, owner: Submitter) -> NewWebhook:
    """A new secret; for `grace_s` seconds messages are signed with the old one too."""
    which = uuid_of(webhook_id, "webhook", WHERE)
    endpoint = parts.store.write(lambda session: rotate_secret(session, which, owner=owner, grace_s=asked.grace_s))
    return NewWebhook.of(endpoint)


@router.post("/{webhook_id}/test", status_code=202)
def test(webhook_id: WebhookId, parts: TheParts, owner: Submitter) -> DeliveryDetail:
    """Send a message of the type `webhook.test`."""
    which = uuid_of(webhook_id, "webhook", WHERE)

    def work(session: Session) -> DeliveryDetail:
        endpoint = get_endpoint(session, which, owner=owner)
        delivery_id = enqueue(session, endpoint, kind=TEST_TYPE, data={"webhook": endpoint.id})
        return DeliveryDetail.of(get_delivery(session, endpoint, delivery_id))

    return parts.store.write(work)


@router.get("/{webhook_id}/deliveries")
def deliveries(
    webhook_id: WebhookId,
    parts: TheParts,
    owner: Owner,
    state: DeliveryState | None = None,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> DeliveryPage:
    """What the webhook was told or is to be told, the newest first; kept for a month."""
    which = uuid_of(webhook_id, "webhook", WHERE)
    name = f"deliveries of {which}"
    before = cursor and parts.cursors.read(cursor, owner=owner, list_name=name)
    with parts.store.read() as session:
        endpoint = get_endpoint(session, which, owner=owner)
        found = list_deliveries(session, endpoint, state=state, before=before, limit=limit + 1)
    more = parts.cursors.write(found[limit - 1].id, owner=owner, list_name=name) if len(found) > limit else None
    return DeliveryPage(items=[DeliveryDetail.of(row) for row in found[:limit]], next_cursor=more)


@router.get("/{webhook_id}/deliveries/{delivery_id}")
def delivery(webhook_id: WebhookId, delivery_id: DeliveryId, parts: TheParts, owner: Owner) -> DeliveryLog:
    """A message, and every attempt to deliver it."""
    which, one = uuid_of(webhook_id, "webhook", WHERE), uuid_of(delivery_id, "delivery", WHERE)
    with parts.store.read() as session:
        found = get_delivery(session, get_endpoint(session, which, owner=owner), one)
        return DeliveryLog.of_attempts(found, attempts_of(session, found))


@router.post("/{webhook_id}/deliveries/{delivery_id}/replay", status_code=202)
def send_again(webhook_id: WebhookId, delivery_id: DeliveryId, parts: TheParts, owner: Submitter) -> DeliveryDetail:
    """Send a message again under the same id, whatever became of it."""
    which, one = uuid_of(webhook_id, "webhook", WHERE), uuid_of(delivery_id, "delivery", WHERE)

    def work(session: Session) -> DeliveryDetail:
        return DeliveryDetail.of(replay(session, get_endpoint(session, which, owner=owner), one))

    return parts.store.write(work)


def _refuse_unreachable(parts: Parts, url: str) -> None:
    if is_mail(url):
        refuse_unmailable(parts.settings, url)
        return
    judge(url, private_allowed=parts.settings.webhooks_to_private_addresses)
