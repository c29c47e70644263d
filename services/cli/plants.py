"""`plants …`: the fleet on the command line."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from nerfmodal.errors import InvalidInput

from services.cli.address import Url
from services.cli.output import Json, number, print_json, results, table_of
from services.cli.scans import Key, service

if TYPE_CHECKING:
    from scanclient import Alarm, Plant

app = typer.Typer(help="Watch plants: latest frequencies, alarms, tables.", no_args_is_help=True)
PlantId = Annotated[str, typer.Argument(metavar="PLANT", help="Id of a plant.", show_default=False)]
Words = list[str] | None
ENDINGS = (".csv", ".parquet", ".zip")


@app.command("list", epilog="Example: nerfmodal plants list --treatment drought --sort ratio")
def list_(
    treatment: Annotated[Words, typer.Option(help="Only of this treatment.")] = None,
    tag: Annotated[Words, typer.Option(help="Only with this tag.")] = None,
    alarm: Annotated[bool | None, typer.Option("--alarm/--no-alarm", help="With, or without, an open alarm.")] = None,
    text: Annotated[str | None, typer.Option(help="Part of id, name, position, species, genotype.")] = None,
    sort: Annotated[str, typer.Option(help="id, name, ratio, alarms …; `-` first: the largest first.")] = "id",
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """List plants with their f/f0 and alarms."""
    with service(url, key) as client:
        found = client.plants.iterate(treatment=treatment or (), tag=tag or (), alarm=alarm, text=text, sort=sort)
        plants = list(found)
    if as_json:
        print_json([_document(plant) for plant in plants])
        return
    columns = ("plant", "treatment", "position", ">scans", "last", ">f/f0", ">alarms", "frequencies (Hz)")
    results().print(table_of(columns, [_row(plant) for plant in plants]))


@app.command(epilog="Example: nerfmodal plants show acai-7")
def show(plant_id: PlantId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Show a plant's tracks."""
    with service(url, key) as client:
        plant, tracks = client.plants.get(plant_id), client.plants.tracks(plant_id)
    if as_json:
        print_json(_document(plant))
        return
    results().print(f"{plant.id}  {plant.name}  {plant.treatment or '–'}  f/f0 {number(plant.ratio, 4)}")
    columns = ("track", "name", "state", ">scans", ">missed", ">doubtful", ">f (Hz)", ">f0 (Hz)", ">f/f0")
    rows = [
        (
            *(track.id, track.name, track.state, str(track.scans), str(track.missed), str(track.doubtful_links)),
            *(number(track.frequency_hz, 4), number(track.reference_hz, 4), number(track.ratio, 4)),
        )
        for track in tracks
    ]
    results().print(table_of(columns, rows))


@app.command(epilog="Example: nerfmodal plants alarms --state open")
def alarms(
    state: Annotated[Words, typer.Option(help="open, acknowledged or closed.")] = None,
    plant: Annotated[str | None, typer.Option(help="Of this plant alone.")] = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """List alarms, the newest first: what changed, since when, how sure."""
    with service(url, key) as client:
        found = list(client.plants.alarms(state=state or (), plant=plant))
    if as_json:
        print_json([_alarm_document(alarm) for alarm in found])
        return
    columns = ("alarm", "plant", "severity", "state", "what")
    results().print(table_of(columns, [(row.id, row.plant, row.severity, row.state, row.title) for row in found]))


@app.command(epilog="Example: nerfmodal plants close 0190c0de-0000-7000-8000-000000000000 --note watered")
def close(
    alarm_id: Annotated[str, typer.Argument(metavar="ALARM", help="Id of an alarm.", show_default=False)],
    note: Annotated[str | None, typer.Option(help="What was done about it.")] = None,
    new_reference: Annotated[bool, typer.Option("--new-reference", help="f0 and the charts begin anew.")] = False,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Close an alarm."""
    with service(url, key) as client:
        alarm = client.plants.settle_alarm(alarm_id, "closed", note, new_reference=new_reference)
    if as_json:
        print_json(_alarm_document(alarm))
    else:
        results().print(f"{alarm.id} is {alarm.state}")


@app.command(epilog="Example: nerfmodal plants environment climate.csv --plant acai-7")
def environment(
    table: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="CSV with a column `at`.")],
    plant: Annotated[str | None, typer.Option(help="Of this plant; by default of the whole house.")] = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Send what surrounded the plants: temperature, humidity, light, soil water, mass, columns of one's own."""
    with service(url, key) as client:
        count = client.plants.store_environment(table.read_text(), plant)
    if as_json:
        print_json({"stored": count})
    else:
        results().print(f"{count} records stored")


@app.command(epilog="Example: nerfmodal plants export fleet.parquet --study greenhouse-1")
def export(
    path: Annotated[Path, typer.Argument(dir_okay=False, help="A .csv or .parquet table, or an RO-Crate (.zip).")],
    study: Annotated[str | None, typer.Option(help="Of this study alone.")] = None,
    plant: Annotated[str | None, typer.Option(help="Of this plant alone.")] = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Write every number as a long table, or a study with its metadata."""
    if path.suffix not in ENDINGS:
        hint = f"End the name in one of: {', '.join(ENDINGS)}."
        raise InvalidInput(f"{path.name} says no format.", where="PATH", hint=hint)
    with service(url, key) as client:
        client.plants.export(path, study=study, plant=plant)
    if as_json:
        print_json({"path": str(path), "bytes": path.stat().st_size})
    else:
        results().print(f"{path} ({path.stat().st_size / 1000:.0f} kB)")


def _row(plant: "Plant") -> tuple[str, ...]:
    modes = "  ".join(f"{mode.frequency_hz:.3f}{'?' if mode.doubtful else ''}" for mode in plant.frequencies)
    alarms = f"{plant.alarms} {plant.worst}" if plant.alarms else "–"
    said = (plant.id, plant.treatment or "–", plant.position or "–", str(plant.scans), plant.last_status or "–")
    return (*said, number(plant.ratio, 4), alarms, modes)


def _document(plant: "Plant") -> dict[str, object]:
    at = plant.last_scan_at
    return asdict(plant) | {"last_scan_at": at.isoformat() if at else None}


def _alarm_document(alarm: "Alarm") -> dict[str, object]:
    times = {name: getattr(alarm, name) for name in ("since", "detected_at", "opened_at")}
    return asdict(alarm) | {name: at.isoformat() if at else None for name, at in times.items()}
