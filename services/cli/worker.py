"""`worker` and `migrate`: the parts of a service on several machines, which share a database and a broker."""

import os
from typing import Annotated

import typer
from nerfmodal.errors import InvalidInput
from scanjobs.messages import QUEUES, TRAIN_CPU, TRAIN_GPU
from scanjobs.settings import Settings

ALIASES = {"train": (TRAIN_CPU, TRAIN_GPU)}
EVERY_QUEUE = ",".join(QUEUES)
QueueNames = Annotated[str, typer.Option("--queues", help="Queues to serve, separated by commas.")]
Slots = Annotated[int | None, typer.Option(min=1, help="Steps computed at the same time.", show_default="cores")]


def worker(queues: QueueNames = EVERY_QUEUE, slots: Slots = None) -> None:
    """Compute the steps of a service; NERFMODAL_DATABASE_URL and NERFMODAL_BROKER_URL say of which."""
    chosen = known_queues(queues)
    from services.worker.main import main  # here: celery takes long to import

    raise typer.Exit(main(chosen, slots))


def migrate() -> None:
    """Bring the database of NERFMODAL_DATABASE_URL up to date."""
    from scanjobs.migrate import upgrade  # here: alembic takes long to import

    settings = Settings()
    if not settings.database_url:
        os.makedirs(settings.data_folder, exist_ok=True)
    upgrade(settings.database)


def known_queues(text: str) -> tuple[str, ...]:
    """The queues that a comma-separated text names; `train` is both queues of trainings. Raises `InvalidInput`."""
    asked = [name.strip() for name in text.split(",") if name.strip()]
    names = tuple(dict.fromkeys(one for name in asked for one in ALIASES.get(name, (name,))))
    unknown = [name for name in names if name not in QUEUES]
    if unknown or not names:
        what = f"is no queue: '{unknown[0]}'." if unknown else "names no queue."
        raise InvalidInput(what, where="--queues", hint=f"Use some of: {', '.join(QUEUES)}.")
    return names
