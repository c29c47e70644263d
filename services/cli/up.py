"""`up`: API and worker in one process, on one data folder, with nothing else to install or start.

The worker holds a lock on the data folder and brings the database up to date; SIGTERM and Ctrl-C give the steps under
way back before the process ends.
"""

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


def up(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0 takes a free one.")] = 8000,
    data: Data = None,
    captures: Annotated[list[Path] | None, typer.Option(help="Folders captures may be read from.")] = None,
    slots: Slots = None,
    until_stdin_closes: Annotated[bool, typer.Option("--until-stdin-closes", hidden=True)] = False,
) -> None:
    """Start API and worker on this machine; stop with Ctrl-C."""
    settings = settings_with(data, captures)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _leave)
    if until_stdin_closes:
        threading.Thread(target=_leave_with_parent, name="parent", daemon=True).start()
    with listen(port) as listener:
        from services.cli.server import serve  # here: uvicorn and celery take long to import

        serve(settings, listener, slots)


def settings_with(data: Path | None, captures: Sequence[Path] | None) -> Settings:
    """The environment's settings with what the command line says instead."""
    changes = {"data_folder": data, "capture_roots": tuple(captures) if captures else None}
    return Settings(**{key: value for key, value in changes.items() if value is not None})  # type: ignore[arg-type]


def listen(port: int) -> socket.socket:
    """A socket that listens on this machine only. Raises `PortTaken`."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
    except OSError as error:
        listener.close()
        hint = "Choose another --port, or 0 for a free one."
        raise PortTaken(f"cannot listen at port {port}: {error.strerror}.", where="--port", hint=hint) from error
    listener.listen(128)
    return listener


def _leave(*_: object) -> None:
    """Unwind: the blocks that this process is in stop the worker and withdraw the address."""
    raise SystemExit(0)


def _leave_with_parent() -> None:
    """Whoever started this process holds the other end of its standard input."""
    sys.stdin.buffer.read()
    os.kill(os.getpid(), signal.SIGTERM)
