"""What the API says of webhooks and their deliveries."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, StrictBool
from scanjobs.account_tables import WebhookAttempt, WebhookDelivery, WebhookEndpoint
from scanjobs.webhooks import MEANING

from services.api.schemas import instant
from services.api.schemas_access import Asked

Url = Annotated[
    str,
    Field(min_length=1, max_length=2000, description="http(s) at a public address, or `mailto:` if the service mails."),
]
Type = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[a-z_]+(\.[a-z_]+)*$")]
Description = Annotated[str, Field(max_length=255, pattern=r"^[^\x00-\x1f\x7f]*$")]
DeliveryState = Literal["waiting", "delivered", "given_up"]
TYPES = ", ".join(MEANING)
Types = Annotated[list[Type], Field(max_length=32, description=f"Types it wants, empty is all: {TYPES} …")]


class NewWebhookRequest(Asked):
    """Who is to be told what."""

    url: Url
    types: Types = Field(default=[])
    description: Description = ""


class WebhookChange(Asked):
    """What is to be another way; what is not given stays."""

    url: Url | None = None
    types: Types | None = None
    description: Description | None = None
    enabled: StrictBool | None = None


class SecretRotation(Asked):
    """How long messages carry the old secret's signature too."""

    grace_s: Annotated[float, Field(ge=0, le=30 * 24 * 3600.0, allow_inf_nan=False)] = 24 * 3600.0


class WebhookDetail(BaseModel):
    """An address that is told what happens."""

    id: str
    url: str
    types: list[str]
    description: str
    enabled: bool = Field(description="False after an answer of 410 Gone, too.")
    created_at: datetime

    @classmethod
    def of(cls, row: WebhookEndpoint) -> "WebhookDetail":
        return cls.model_validate(_fields(row))


class NewWebhook(WebhookDetail):
    """With the secret that its messages are signed with, which is never shown again."""

    secret: str = Field(description="Verify messages with it, as Standard Webhooks says.")

    @classmethod
    def of(cls, row: WebhookEndpoint) -> "NewWebhook":
        return cls.model_validate(_fields(row) | {"secret": row.secret})


class WebhookList(BaseModel):
    """The webhooks of an owner, the newest first."""

    items: list[WebhookDetail]


class DeliveryDetail(BaseModel):
    """A message for one webhook."""

    id: str = Field(description="The same in every attempt: `webhook-id`.")
    type: str
    state: DeliveryState
    attempts: int
    next_at: datetime | None = Field(description="When it is sent next; null when it is not.")
    created_at: datetime
    delivered_at: datetime | None
    payload: dict[str, Any]

    @classmethod
    def of(cls, row: WebhookDelivery) -> "DeliveryDetail":
        return cls.model_validate(_delivery_fields(row))


class AttemptDetail(BaseModel):
    """One try to deliver: a status, or the reason why there is none."""

    number: int
    at: datetime
    took_s: float
    status: int | None
    error: str | None
    answer: str = Field(description="The beginning of what the endpoint said.")

    @classmethod
    def of(cls, row: WebhookAttempt) -> "AttemptDetail":
        return cls.model_validate(
            {
                "number": row.number,
                "at": instant(row.at),
                "took_s": round(row.took_s, 3),
                "status": row.status,
                "error": row.error,
                "answer": row.answer,
            }
        )


class DeliveryLog(DeliveryDetail):
    """A message with every attempt to deliver it."""

    log: list[AttemptDetail]

    @classmethod
    def of_attempts(cls, row: WebhookDelivery, attempts: tuple[WebhookAttempt, ...]) -> "DeliveryLog":
        return cls.model_validate(_delivery_fields(row) | {"log": [AttemptDetail.of(one) for one in attempts]})


class DeliveryPage(BaseModel):
    """Messages, the newest first."""

    items: list[DeliveryDetail]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")


def _fields(row: WebhookEndpoint) -> dict[str, Any]:
    return {
        "id": row.id,
        "url": row.url,
        "types": row.types,
        "description": row.description,
        "enabled": row.enabled,
        "created_at": instant(row.created_at),
    }


def _delivery_fields(row: WebhookDelivery) -> dict[str, Any]:
    return {
        "id": row.id,
        "type": row.type,
        "state": row.state,
        "attempts": row.attempts,
        "next_at": instant(row.next_at) if row.state == "waiting" else None,
        "created_at": instant(row.created_at),
        "delivered_at": instant(row.delivered_at),
        "payload": row.payload,
    }
