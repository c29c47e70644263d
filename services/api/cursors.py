"""Opaque cursors: where a page ended, signed for one owner and one list.

What somebody else was given, what was given for another list, and what was made up, is refused alike. The signing
secret lies in the database, so that every process of a service reads the cursors of every other.
"""

import base64
import binascii
import hashlib
import hmac
import json
import secrets
from contextlib import suppress
from typing import Any

from scanjobs.account_tables import ServiceSecret
from scanjobs.clock import now_s
from scanjobs.errors import InvalidCursor
from scanjobs.store import Store
from sqlalchemy import insert
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

NAME = "cursors"
MAC_BYTES = 16


class Cursors:
    """Writes and reads cursors; fetches the secret when it first needs it."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._secret: bytes | None = None

    def write(self, place: Any, *, owner: str, list_name: str) -> str:
        """The cursor of a place in an owner's list."""
        body = json.dumps(place, separators=(",", ":")).encode()
        return _text(self._mac(body, owner, list_name) + body)

    def read(self, cursor: str, *, owner: str, list_name: str) -> Any:
        """The place that a cursor stands for. Raises `InvalidCursor`."""
        raw = _bytes(cursor)
        mac, body = raw[:MAC_BYTES], raw[MAC_BYTES:]
        if not hmac.compare_digest(mac, self._mac(body, owner, list_name)):
            raise _invalid()
        return json.loads(body)

    def _mac(self, body: bytes, owner: str, list_name: str) -> bytes:
        if self._secret is None:
            self._secret = service_secret(self._store, NAME)
        message = json.dumps([owner, list_name]).encode() + b"\0" + body
        return hmac.new(self._secret, message, hashlib.sha256).digest()[:MAC_BYTES]


def service_secret(store: Store, name: str) -> bytes:
    """The secret of this name, made by whoever asks first."""
    with store.read() as session:
        row = session.get(ServiceSecret, name)
    if row is not None:
        return row.value.encode()

    def make(session: Session) -> None:
        session.execute(insert(ServiceSecret).values(name=name, value=secrets.token_urlsafe(32), created_at=now_s()))

    with suppress(IntegrityError):  # another process was faster: its secret is the one
        store.write(make)
    return service_secret(store, name)


def _text(raw: bytes) -> str:
    return base64.urlsafe_b64encode(raw).decode().rstrip("=")


def _bytes(cursor: str) -> bytes:
    try:
        return base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True)
    except (ValueError, binascii.Error) as error:
        raise _invalid() from error


def _invalid() -> InvalidCursor:
    return InvalidCursor("the cursor was not made by this service.", where="cursor", hint="Start again without one.")
