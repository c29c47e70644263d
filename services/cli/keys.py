"""`keys …`: make, list, rotate and revoke API keys in the database of this machine's settings.

For the operator: whoever can read the database needs no key. Over HTTP the same is `/v1/keys`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from scanjobs.scopes import LOCAL_OWNER, Scope
from scanjobs.settings import Settings

from services.cli.output import Json, print_json, results, table_of

if TYPE_CHECKING:  # sqlalchemy takes long to import
    from scanjobs.account_tables import ApiKey
    from scanjobs.owners import Issued
    from scanjobs.store import Store

DAY_S = 24 * 3600.0
app = typer.Typer(help="Make and revoke the API keys of a service.", no_args_is_help=True)
Data = Annotated[Path | None, typer.Option(help="Folder of the database.", show_default=".nerfmodal")]
Owner = Annotated[str, typer.Option(help="Whose scans the key opens.")]
KeyId = Annotated[str, typer.Argument(metavar="KEY", help="Id of a key, as in the list.", show_default=False)]


@app.command(epilog="Example: nerfmodal keys create --owner greenhouse --scope read --scope submit --days 365")
def create(
    owner: Owner = LOCAL_OWNER,
    name: Annotated[str, typer.Option(help="What the key is for.")] = "key",
    scope: Annotated[list[Scope] | None, typer.Option(help="read, submit or admin.", show_default="submit")] = None,
    days: Annotated[float | None, typer.Option(min=0.001, help="Days until it expires.", show_default="never")] = None,
    data: Data = None,
    as_json: Json = False,
) -> None:
    """Make a key and print it: it is never shown again."""
    from scanjobs.owners import issue_key

    with database(data) as store:
        issued = store.write(
            lambda session: issue_key(
                session,
                owner=owner,
                name=name,
                scopes=scope or [Scope.READ, Scope.SUBMIT],
                expires_in_s=None if days is None else days * DAY_S,
            )
        )
    _tell(issued, as_json=as_json)


@app.command("list", epilog="Example: nerfmodal keys list --owner greenhouse")
def list_(
    owner: Annotated[str | None, typer.Option(help="Of this owner alone.")] = None,
    data: Data = None,
    as_json: Json = False,
) -> None:
    """List keys, living or not, without their secrets."""
    from scanjobs.owners import list_keys

    with database(data) as store, store.read() as session:
        keys = list_keys(session, owner=owner)
    if as_json:
        print_json([_document(key) for key in keys])
        return
    columns = ("id", "owner", "name", "scopes", "expires", "revoked", "last used")
    rows = [
        (key.id, key.owner, key.name, key.scopes, _day(key.expires_at), _day(key.revoked_at), _day(key.last_used_at))
        for key in keys
    ]
    results().print(table_of(columns, rows))


@app.command(epilog="Example: nerfmodal keys rotate 0190c0de-0000-7000-8000-000000000000 --grace-hours 24")
def rotate(
    key_id: KeyId,
    owner: Owner = LOCAL_OWNER,
    grace_hours: Annotated[float, typer.Option(min=0, help="How long the old key goes on.")] = 24.0,
    data: Data = None,
    as_json: Json = False,
) -> None:
    """Make a key with the same rights, and let the old one end."""
    from scanjobs.owners import rotate_key

    with database(data) as store:
        issued = store.write(lambda session: rotate_key(session, key_id, owner=owner, grace_s=grace_hours * 3600.0))
    _tell(issued, as_json=as_json)


@app.command(epilog="Example: nerfmodal keys revoke 0190c0de-0000-7000-8000-000000000000")
def revoke(key_id: KeyId, owner: Owner = LOCAL_OWNER, data: Data = None, as_json: Json = False) -> None:
    """From now on the key opens nothing."""
    from scanjobs.owners import revoke_key

    with database(data) as store:
        key = store.write(lambda session: revoke_key(session, key_id, owner=owner))
    if as_json:
        print_json(_document(key))
    else:
        typer.echo(f"{key.id} is revoked")


@contextmanager
def database(data: Path | None) -> Iterator["Store"]:
    """The database of the settings, brought up to date."""
    from scanjobs.migrate import upgrade
    from scanjobs.store import open_store

    settings = Settings() if data is None else Settings(data_folder=data)
    settings.data_folder.mkdir(parents=True, exist_ok=True)
    upgrade(settings.database)
    store = open_store(settings.database)
    try:
        yield store
    finally:
        store.close()


def has_living_key(settings: Settings) -> bool:
    """Whether somebody could come in from another machine."""
    from scanjobs.owners import any_living_key

    with database(settings.data_folder) as store, store.read() as session:
        return any_living_key(session)


def _tell(issued: "Issued", *, as_json: bool) -> None:
    if as_json:
        print_json(_document(issued.key) | {"secret": issued.secret})
    else:
        typer.echo(issued.secret)


def _document(key: "ApiKey") -> dict[str, object]:
    return {
        "id": key.id,
        "owner": key.owner,
        "name": key.name,
        "scopes": key.scopes.split(","),
        "created_at": _instant(key.created_at),
        "expires_at": _instant(key.expires_at),
        "revoked_at": _instant(key.revoked_at),
        "last_used_at": _instant(key.last_used_at),
    }


def _instant(seconds: float | None) -> str | None:
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC).isoformat()


def _day(seconds: float | None) -> str:
    return "–" if seconds is None else f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M}"
