"""API keys of the caller's owner: made, listed, rotated and revoked by who has the scope `admin`."""

from typing import Annotated

from fastapi import APIRouter, Path, Response
from scanjobs.owners import get_key, issue_key, list_keys, revoke_key, rotate_key

from services.api.dependencies import Administrator, TheParts, uuid_of
from services.api.schemas_access import KeyDetail, KeyList, NewKey, NewKeyRequest, Rotation

router = APIRouter(prefix="/v1/keys", tags=["keys"])
Name = Annotated[str, Path(description="Id of a key; not the key itself.")]
KEY_LIST = "GET /v1/keys"


@router.post("", status_code=201)
def create(asked: NewKeyRequest, parts: TheParts, owner: Administrator, response: Response) -> NewKey:
    """Make a key. Its secret is in this answer and nowhere else."""
    issued = parts.store.write(
        lambda session: issue_key(
            session,
            owner=owner,
            name=asked.name,
            scopes=asked.scopes,
            expires_in_s=asked.expires_in_s,
            requests_per_minute=asked.requests_per_minute,
        )
    )
    response.headers["Location"] = f"/v1/keys/{issued.key.id}"
    return NewKey.of_issued(issued)


@router.get("")
def list_(parts: TheParts, owner: Administrator) -> KeyList:
    """Every key of this owner, living or not, without secrets; the newest first."""
    with parts.store.read() as session:
        return KeyList(items=[KeyDetail.of(key) for key in list_keys(session, owner=owner)])


@router.get("/{key_id}")
def show(key_id: Name, parts: TheParts, owner: Administrator) -> KeyDetail:
    """One key, without its secret."""
    with parts.store.read() as session:
        return KeyDetail.of(get_key(session, uuid_of(key_id, "key", KEY_LIST), owner=owner))


@router.post("/{key_id}/rotate", status_code=201)
def rotate(key_id: Name, asked: Rotation, parts: TheParts, owner: Administrator, response: Response) -> NewKey:
    """A new key with the same rights; the old one goes on for `grace_s` seconds. 409 unless it is alive."""
    which = uuid_of(key_id, "key", KEY_LIST)
    issued = parts.store.write(lambda session: rotate_key(session, which, owner=owner, grace_s=asked.grace_s))
    response.headers["Location"] = f"/v1/keys/{issued.key.id}"
    return NewKey.of_issued(issued)


@router.delete("/{key_id}", status_code=200)
def revoke(key_id: Name, parts: TheParts, owner: Administrator) -> KeyDetail:
    """From now on the key opens nothing."""
    which = uuid_of(key_id, "key", KEY_LIST)
    return KeyDetail.of(parts.store.write(lambda session: revoke_key(session, which, owner=owner)))
