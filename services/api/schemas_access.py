"""What the API says of keys and webhooks."""

from datetime import datetime
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field
from scanjobs.account_tables import ApiKey
from scanjobs.owners import Issued
from scanjobs.scopes import Scope

from services.api.schemas import instant

YEARS_S = 10 * 365 * 24 * 3600.0
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]+$")]


class Asked(BaseModel):
    """A body of a request: unknown keys are refused; its numbers and truths are strict, for true is no number."""

    model_config = ConfigDict(extra="forbid")


class NewKeyRequest(Asked):
    """The key that is asked for."""

    name: Name
    scopes: Annotated[list[Scope], Field(min_length=1, max_length=3)] = [Scope.READ, Scope.SUBMIT]
    expires_in_s: Annotated[float, Field(strict=True, gt=0, le=YEARS_S, allow_inf_nan=False)] | None = None
    requests_per_minute: Annotated[int, Field(ge=1, le=10**6)] | None = None


class Rotation(Asked):
    """How long the old key goes on."""

    grace_s: Annotated[float, Field(strict=True, ge=0, le=YEARS_S, allow_inf_nan=False)] = 24 * 3600.0


class KeyDetail(BaseModel):
    """A key, without its secret."""

    id: str
    name: str
    owner: str
    scopes: list[Scope]
    requests_per_minute: int | None = Field(description="Null is the service's own limit.")
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None
    last_used_at: datetime | None = Field(description="To within ten minutes.")
    rotated_to: str | None = Field(description="Id of the key that replaces it.")

    @classmethod
    def of(cls, key: ApiKey) -> "KeyDetail":
        return cls.model_validate(_fields(key))


class NewKey(KeyDetail):
    """A new key with its secret, which is never shown again."""

    secret: str = Field(description="Send it as `Authorization: Bearer …`. Keep it: nobody can read it again.")

    @classmethod
    def of_issued(cls, issued: Issued) -> "NewKey":
        return cls.model_validate(_fields(issued.key) | {"secret": issued.secret})


class KeyList(BaseModel):
    """The keys of an owner, the newest first."""

    items: list[KeyDetail]


def _fields(key: ApiKey) -> dict[str, object]:
    return {
        "id": key.id,
        "name": key.name,
        "owner": key.owner,
        "scopes": key.scopes.split(","),
        "requests_per_minute": key.requests_per_minute,
        "created_at": instant(key.created_at),
        "expires_at": instant(key.expires_at),
        "revoked_at": instant(key.revoked_at),
        "last_used_at": instant(key.last_used_at),
        "rotated_to": key.rotated_to,
    }
