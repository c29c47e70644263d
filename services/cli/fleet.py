"""`demo-fleet`: two hundred plants that were scanned for two weeks, without a camera."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer
from scanjobs.scopes import LOCAL_OWNER
from scanjobs.settings import Settings

from services.cli.keys import database
from services.cli.output import Json, print_json, results

Data = Annotated[Path | None, typer.Option(help="Folder of the service.", show_default=".nerfmodal")]


def demo_fleet(
    plants: Annotated[int, typer.Option(min=1, max=5000, help="How many plants.")] = 200,
    scans: Annotated[int, typer.Option(min=1, max=1000, help="Scans of each, two a day, up to now.")] = 25,
    full: Annotated[int, typer.Option(min=0, max=20, help="Plants whose newest scan has every file.")] = 3,
    owner: Annotated[str, typer.Option(help="Whose they are.")] = LOCAL_OWNER,
    remove: Annotated[bool, typer.Option("--remove", help="Remove what an earlier call has made.")] = False,
    data: Data = None,
    as_json: Json = False,
) -> None:
    """Fill a service with simulated plants: drying, growth, heat, missed modes, failed scans, alarms.

    What is there already is left as it is; `nerfmodal up` may run meanwhile. The newest scan of `--full` plants is
    drawn and identified like a real one (some seconds each); the others have modes and shapes alone.
    """
    from scanjobs.fleet.seeding import remove_fleet, seed_fleet
    from scanjobs.object_store import open_artifacts

    from services.cli.demo_scan import draw_scan
    from services.cli.transfers import counting_bar

    settings = Settings() if data is None else Settings(data_folder=data)
    began = time.monotonic()
    with database(data) as store:
        if remove:
            count = remove_fleet(store, owner=owner)
            _tell({"removed": count}, f"{count} plants removed", as_json=as_json)
            return
        with counting_bar("plants", plants, quiet=as_json) as moved:
            made = seed_fleet(
                store,
                open_artifacts(settings),
                owner=owner,
                plants=plants,
                scans=scans,
                now=time.time(),
                full=full,
                draw=draw_scan,
                on_plant=moved,
            )
    took = time.monotonic() - began
    document = {"plants": made.plants, "scans": made.scans, "full": list(made.full), "took_s": round(took, 1)}
    shown = f"; the newest scans of {', '.join(made.full)} have every file" if made.full else ""
    _tell(document, f"{made.plants} plants and {made.scans} scans made in {took:.1f} s{shown}", as_json=as_json)


def _tell(document: dict[str, Any], sentence: str, *, as_json: bool) -> None:
    if as_json:
        print_json(document)
    else:
        results().print(sentence)
