"""Where a service listens: `nerfmodal up` writes it into its data folder, the other commands look there."""

import json
import os
from pathlib import Path
from typing import Annotated

import typer

DATA_FOLDER = Path(".nerfmodal")
FILE_NAME = "server.json"
Url = Annotated[
    str | None,
    typer.Option("--url", envvar="NERFMODAL_URL", help="Address of the service; by default the one started here."),
]


def announce(data_folder: Path, address: str) -> None:
    """Write down that this process listens at `address`."""
    staged = data_folder / f".{FILE_NAME}.{os.getpid()}"
    staged.write_text(json.dumps({"address": address, "pid": os.getpid()}))
    os.replace(staged, data_folder / FILE_NAME)


def withdraw(data_folder: Path) -> None:
    """Nobody listens any more."""
    (data_folder / FILE_NAME).unlink(missing_ok=True)


def announced(data_folder: Path) -> str | None:
    """The address of the service on a data folder, None where none is announced."""
    try:
        document = json.loads((data_folder / FILE_NAME).read_text())
    except (OSError, ValueError):
        return None
    return str(document["address"]) if isinstance(document, dict) and "address" in document else None


def address_of(url: str | None) -> str:
    """The service that a command speaks to: the one asked for, the one started in this folder, or port 8000 here."""
    return url or announced(DATA_FOLDER) or "http://127.0.0.1:8000"
