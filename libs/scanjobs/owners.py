"""Who may do what: owners, and the API keys that let a program act for one.

A key is ``nm_`` and 256 random bits. It is shown once; the database holds its SHA-256, which is enough to find it and
too little to use it (a slow hash protects guessable secrets; this one cannot be guessed). Whether a key is alive is
asked of the database at every request, so that a revocation counts at once.
"""

import hashlib
import re
import secrets
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from nerfmodal.errors import InvalidInput
from sqlalchemy import insert, or_, select, update
from sqlalchemy.orm import Session

from scanjobs.account_tables import ApiKey, Owner
from scanjobs.clock import now_s
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.repository import new_id
from scanjobs.scopes import Principal, Scope

PREFIX: Final = "nm_"
KEY_PATTERN: Final = re.compile(r"nm_[A-Za-z0-9_-]{43}")
OWNER_PATTERN: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
NOTED_EVERY_S: Final = 600.0
"""How exactly the last use of a key is known: a write for every request would cost more than the request."""


@dataclass(frozen=True, slots=True)
class Issued:
    """A new key's row and its secret, which nobody can read again."""

    key: ApiKey
    secret: str


def issue_key(
    session: Session,
    *,
    owner: str,
    name: str,
    scopes: Collection[Scope],
    expires_in_s: float | None = None,
    requests_per_minute: int | None = None,
) -> Issued:
    """Make a key; an owner that is not known yet is made with it.

    Raises
    ------
    InvalidInput
        The owner's name holds characters that names do not have, or there is no scope.
    """
    if not OWNER_PATTERN.fullmatch(owner):
        hint = "Use letters, digits, '_', '.' and '-', beginning with a letter or digit."
        raise InvalidInput(f"the owner {owner!r} is no name.", where="/owner", hint=hint)
    if not scopes:
        raise InvalidInput("a key without a scope is good for nothing.", where="/scopes", hint="Give at least 'read'.")
    ensure_owner(session, owner)
    secret = PREFIX + secrets.token_urlsafe(32)
    key_id = new_id()
    values = {
        "id": key_id,
        "owner": owner,
        "name": name,
        "secret_sha256": digest_of(secret),
        "scopes": ",".join(sorted(scopes)),
        "requests_per_minute": requests_per_minute,
        "created_at": now_s(),
        "expires_at": None if expires_in_s is None else now_s() + expires_in_s,
    }
    session.execute(insert(ApiKey).values(values))
    return Issued(get_key(session, key_id, owner=owner), secret)


def ensure_owner(session: Session, owner: str) -> None:
    """Make the owner's row unless it is there."""
    if session.get(Owner, owner) is None:
        session.execute(insert(Owner).values(id=owner, weight=1.0, created_at=now_s()))


def authenticate(session: Session, secret: str) -> ApiKey | None:
    """The living key of a secret; None for one that is unknown, revoked or past its time."""
    if not KEY_PATTERN.fullmatch(secret):
        return None
    alive = or_(ApiKey.expires_at.is_(None), ApiKey.expires_at > now_s())
    query = select(ApiKey).where(ApiKey.secret_sha256 == digest_of(secret), ApiKey.revoked_at.is_(None), alive)
    return session.scalars(query).one_or_none()


def is_alive(session: Session, key_id: str) -> bool:
    """Whether the key still opens anything."""
    alive = or_(ApiKey.expires_at.is_(None), ApiKey.expires_at > now_s())
    query = select(ApiKey.id).where(ApiKey.id == key_id, ApiKey.revoked_at.is_(None), alive)
    return session.scalars(query).one_or_none() is not None


def note_use(session: Session, key_id: str) -> None:
    """Remember that the key was used now, to within ten minutes."""
    old = or_(ApiKey.last_used_at.is_(None), ApiKey.last_used_at < now_s() - NOTED_EVERY_S)
    session.execute(update(ApiKey).where(ApiKey.id == key_id, old).values(last_used_at=now_s()))


def principal_of(key: ApiKey) -> Principal:
    """Who the bearer of a key is."""
    return Principal(
        owner=key.owner,
        scopes=frozenset(Scope(word) for word in key.scopes.split(",")),
        key_id=key.id,
        requests_per_minute=key.requests_per_minute,
    )


def get_key(session: Session, key_id: str, *, owner: str) -> ApiKey:
    """An owner's key, living or not. Raises `NotFound`."""
    key = session.scalars(select(ApiKey).where(ApiKey.id == key_id, ApiKey.owner == owner)).one_or_none()
    if key is None:
        raise NotFound(f"there is no key {key_id}.", hint="List your keys with GET /v1/keys.")
    return key


def list_keys(session: Session, *, owner: str | None) -> tuple[ApiKey, ...]:
    """The keys of an owner, or of all, the newest first."""
    query = select(ApiKey).order_by(ApiKey.id.desc())
    return tuple(session.scalars(query if owner is None else query.where(ApiKey.owner == owner)))


def rotate_key(session: Session, key_id: str, *, owner: str, grace_s: float) -> Issued:
    """A new key with the same rights; the old one dies `grace_s` from now, or earlier if it was to.

    Raises
    ------
    NotFound
        No such key.
    IllegalTransition
        It is revoked or expired, or has been rotated before.
    """
    old = get_key(session, key_id, owner=owner)
    now = session.scalars(select(now_s())).one()
    if old.revoked_at is not None or old.rotated_to is not None or (old.expires_at or now + 1) <= now:
        raise IllegalTransition("only a living key that was not rotated can be.", hint="Make a new key.")
    issued = issue_key(
        session,
        owner=owner,
        name=old.name,
        scopes=principal_of(old).scopes,
        expires_in_s=None if old.expires_at is None else old.expires_at - old.created_at,
        requests_per_minute=old.requests_per_minute,
    )
    ends = now + grace_s if old.expires_at is None else min(old.expires_at, now + grace_s)
    session.execute(update(ApiKey).where(ApiKey.id == old.id).values(expires_at=ends, rotated_to=issued.key.id))
    return issued


def revoke_key(session: Session, key_id: str, *, owner: str) -> ApiKey:
    """From now on the key opens nothing; revoking twice is the same as once. Raises `NotFound`."""
    key = get_key(session, key_id, owner=owner)
    unrevoked = update(ApiKey).where(ApiKey.id == key.id, ApiKey.revoked_at.is_(None))
    session.execute(unrevoked.values(revoked_at=now_s()))
    session.refresh(key)
    return key


def any_living_key(session: Session) -> bool:
    """Whether somebody could come in at all."""
    alive = or_(ApiKey.expires_at.is_(None), ApiKey.expires_at > now_s())
    return session.scalars(select(ApiKey.id).where(ApiKey.revoked_at.is_(None), alive).limit(1)).first() is not None


def digest_of(secret: str) -> str:
    """SHA-256, hexadecimal: what the database knows of a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()
