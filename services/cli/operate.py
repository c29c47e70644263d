"""`fsck` and `workers`: what an operator asks of the database itself, with the settings that the service has."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from nerfmodal.errors import InvalidInput
from scanjobs.settings import Settings

if TYPE_CHECKING:  # sqlalchemy takes long to import
    from scanjobs.tables import Worker

Names = Annotated[list[str], typer.Argument(help="Worker ids, or the first letters of one; `all` is every worker.")]
AsJson = Annotated[bool, typer.Option("--json", help="For machines.")]
EVERY = "all"
app = typer.Typer(help="The workers of a service: look, pause, resume, drain.", no_args_is_help=True)


def fsck(as_json: AsJson = False) -> None:
    """Check the invariants of the database and the bytes of every file; exit code 1 when one is violated.

    It reads only, and may be run while the service works.
    """
    from scanjobs.fsck import check
    from scanjobs.object_store import open_artifacts
    from scanjobs.store import open_store

    settings = Settings()
    with open_store(settings.database).read() as session:
        found = check(session, open_artifacts(settings))
    if as_json:
        typer.echo(json.dumps({"violations": list(found)}))
    else:
        typer.echo("\n".join(found) or "sound: every invariant holds and every file has its digest.")
    raise typer.Exit(1 if found else 0)


@app.command("list", epilog="Example: nerfmodal workers list")
def list_(as_json: AsJson = False) -> None:
    """Every worker that has not said goodbye."""
    rows = [
        {"id": one.id, "state": one.state, "host": one.host, "slots": one.slots, "queues": one.queues}
        for one in _present()
    ]
    if as_json:
        typer.echo(json.dumps(rows))
    for row in rows if not as_json else ():
        typer.echo(f"{row['id']}  {row['state']:<9} {row['slots']} slots  {row['host']}  {row['queues']}")


@app.command(epilog="Example: nerfmodal workers pause all")
def pause(names: Names) -> None:
    """Take no more steps; what is computed is finished, and the worker stays."""
    _do("pause", names)


@app.command(epilog="Example: nerfmodal workers resume all")
def resume(names: Names) -> None:
    """Take steps again."""
    _do("resume", names)


@app.command(epilog="Example: nerfmodal workers drain 01a20466")
def drain(names: Names) -> None:
    """Give the steps under way back, with what they have saved, and end."""
    _do("drain", names)


def _present() -> "tuple[Worker, ...]":
    from scanjobs.store import open_store
    from scanjobs.workers import present_workers

    with open_store(Settings().database).read() as session:
        return present_workers(session)


def _do(verb: Literal["pause", "resume", "drain"], names: Sequence[str]) -> None:
    from scanjobs import workers
    from scanjobs.store import open_store

    chosen = _chosen(names)
    ask = {"pause": workers.pause, "resume": workers.resume, "drain": workers.drain}[verb]
    open_store(Settings().database).write(lambda session: ask(session, chosen))


def _chosen(names: Sequence[str]) -> list[str]:
    """Ids of the workers that are meant. Raises `InvalidInput`."""
    known = [one.id for one in _present()]
    if EVERY in names:
        return known
    chosen: list[str] = []
    for name in names:
        fit = [one for one in known if one.startswith(name)]
        if len(fit) != 1:
            what = f"means {len(fit)} workers: '{name}'."
            raise InvalidInput(what, where="NAMES", hint="See `nerfmodal workers list`.")
        chosen += fit
    return chosen
