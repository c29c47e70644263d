"""`up`: API and worker in one process, on one data folder, with nothing else to install or start.

The worker holds a lock on the data folder and brings the database up to date; SIGTERM and Ctrl-C give the steps under
way back before the process ends.
"""

import ipaddress
import os
import signal
import socket
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from nerfmodal.errors import NerfmodalError
from scanjobs.settings import Settings

HOST = "127.0.0.1"
Data = Annotated[Path | None, typer.Option(help="Folder of database and files.", show_default=".nerfmodal")]
Slots = Annotated[int | None, typer.Option(min=1, help="Steps computed at the same time.", show_default="cores")]


class PortTaken(NerfmodalError):
    """The port cannot be listened at; choose another one, or 0 for a free one."""

    code = "PORT_TAKEN"


class KeysNeeded(NerfmodalError):
    """The service would be open to other machines and nobody has a key; make one first."""

    code = "KEYS_NEEDED"


def up(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 8000,
    host: Annotated[str, typer.Option(help="Address to listen at; others than this machine's own need keys.")] = HOST,
    data: Data = None,
    captures: Annotated[list[Path] | None, typer.Option(help="Folders captures may be read from.")] = None,
    slots: Slots = None,
    until_stdin_closes: Annotated[bool, typer.Option("--until-stdin-closes", hidden=True)] = False,
) -> None:
    """Start API and worker on this machine; stop with Ctrl-C."""
    settings = settings_with(data, captures)
    if not is_loopback(host):
        settings = asking_for_keys(settings)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _leave)
    if until_stdin_closes:
        threading.Thread(target=_leave_with_parent, name="parent", daemon=True).start()
    with listen(port, host) as listener:
        from services.cli.server import serve  # here: uvicorn and celery take long to import

        serve(settings, listener, slots)


def settings_with(data: Path | None, captures: Sequence[Path] | None) -> Settings:
    """The environment's settings with what the command line says instead."""
    changes = {"data_folder": data, "capture_roots": tuple(captures) if captures else None}
    return Settings(**{key: value for key, value in changes.items() if value is not None})  # type: ignore[arg-type]


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def asking_for_keys(settings: Settings) -> Settings:
    """The same settings with every caller needing a key. Raises `KeysNeeded` where nobody has one."""
    from services.cli.keys import has_living_key

    if not has_living_key(settings):
        hint = "Make one with `nerfmodal keys create`, or listen at 127.0.0.1."
        raise KeysNeeded("callers on other machines need an API key, and there is none.", where="--host", hint=hint)
    return settings.model_copy(update={"keyless": False})


def listen(port: int, host: str = HOST) -> socket.socket:
    """A socket that listens at an address of this machine. Raises `PortTaken`.

    It says that it is TCP's: asyncio switches Nagle's algorithm off for such sockets alone, and with it on every answer
    on a kept connection waits 40 ms, until the reader acknowledges its headers.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        hint = "Choose another --port, or 0 for a free one."
        raise PortTaken(f"cannot listen at {host}:{port}: {error.strerror}.", where="--port", hint=hint) from error
    listener.listen(128)
    return listener


def _leave(*_: object) -> None:
    """Unwind: the blocks that this process is in stop the worker and withdraw the address."""
    raise SystemExit(0)


def _leave_with_parent() -> None:
    """Whoever started this process holds the other end of its standard input."""
    sys.stdin.buffer.read()
    os.kill(os.getpid(), signal.SIGTERM)
