"""`scans …`: the HTTP client on the command line."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.address import Url, address_of
from services.cli.output import Json, modes_table, print_json, results, table_of
from services.cli.progress import duration, scan_bars
from services.cli.specs import SpecFile, located, read_spec
from services.cli.transfers import byte_bar, read_changes

if TYPE_CHECKING:
    from scanclient import Client, Scan

HIGHEST_LIMIT = 200
app = typer.Typer(help="Submit scans to a service and fetch what they found.", no_args_is_help=True)
ScanId = Annotated[str, typer.Argument(metavar="SCAN", help="Id of a scan.", show_default=False)]
Key = Annotated[str | None, typer.Option("--key", envvar="NERFMODAL_KEY", help="API key.")]
Step = Annotated[str | None, typer.Option("--from", help="Compute this step and all after it afresh.")]


@contextmanager
def service(url: str | None, key: str | None) -> Iterator["Client"]:
    """A client for the service that a command speaks to; its retries are not logged."""
    from scanclient import Client
    from stamina.instrumentation import set_on_retry_hooks

    set_on_retry_hooks([])
    with Client(address_of(url), key=key) as client:
        yield client


@app.command(epilog="Example: nerfmodal scans submit examples/acai.yaml --wait")
def submit(
    spec_file: SpecFile,
    idempotency_key: Annotated[str | None, typer.Option(help="Repeat a request without starting twice.")] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Follow the scan to its end.")] = False,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Start a scan and print its id."""
    spec = read_spec(spec_file)
    with service(url, key) as client:
        scan = client.submit(located(spec), idempotency_key)
        if wait:
            scan = follow(client, scan.id, quiet=as_json)
    show_scan(scan, as_json=as_json, brief=not wait)


@app.command("list", epilog="Example: nerfmodal scans list --status running --tag greenhouse")
def list_(
    status: Annotated[str | None, typer.Option(help="queued, running, succeeded, failed or canceled.")] = None,
    plant: Annotated[str | None, typer.Option(help="Only scans of this plant.")] = None,
    tag: Annotated[str | None, typer.Option(help="Only scans with this tag.")] = None,
    limit: Annotated[int, typer.Option(min=1, max=HIGHEST_LIMIT, help="At most so many, the newest first.")] = 20,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """List scans, the newest first."""
    with service(url, key) as client:
        page = client.list(status=status, plant=plant, tag=tag, limit=limit)
    if as_json:
        print_json([document_of(scan) for scan in page.items])
        return
    columns = ("scan", "name", "status", ">done", "plant", "tags", "created (UTC)")
    results().print(table_of(columns, [_row(scan) for scan in page.items]))


@app.command(epilog="Example: nerfmodal scans show 0190c0de-0000-7000-8000-000000000000")
def show(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Show a scan with its progress."""
    with service(url, key) as client:
        show_scan(client.get(scan_id), as_json=as_json)


@app.command(epilog="Example: nerfmodal scans watch 0190c0de-0000-7000-8000-000000000000")
def watch(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Follow a scan to its end; exit code 1 where it fails."""
    with service(url, key) as client:
        show_scan(follow(client, scan_id, quiet=as_json), as_json=as_json)


@app.command(epilog="Example: nerfmodal scans cancel 0190c0de-0000-7000-8000-000000000000")
def cancel(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Stop a scan."""
    with service(url, key) as client:
        show_scan(client.cancel(scan_id), as_json=as_json)


@app.command(epilog="Example: nerfmodal scans pause 0190c0de-0000-7000-8000-000000000000")
def pause(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Begin no more steps of a scan; what is computed is finished and counts."""
    with service(url, key) as client:
        show_scan(client.pause(scan_id), as_json=as_json)


@app.command(epilog="Example: nerfmodal scans resume 0190c0de-0000-7000-8000-000000000000")
def resume(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Go on with a paused scan."""
    with service(url, key) as client:
        show_scan(client.resume(scan_id), as_json=as_json)


@app.command(epilog="Example: nerfmodal scans retry 0190c0de-0000-7000-8000-000000000000 --from scan.identify")
def retry(
    scan_id: ScanId,
    from_step: Step = None,
    frames: Annotated[list[int] | None, typer.Option("--frame", help="Of this frame alone; needs --from.")] = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Run an ended scan again: what had not succeeded, or everything from a step on."""
    with service(url, key) as client:
        show_scan(client.retry(scan_id, from_step, frames or ()), as_json=as_json)


@app.command(epilog="Example: nerfmodal scans fork 0190c0de-0000-7000-8000-000000000000 changes.yaml --wait")
def fork(
    scan_id: ScanId,
    changes: Annotated[Path, typer.Argument(help="What is to be another way: YAML or JSON, merged into the scan's.")],
    wait: Annotated[bool, typer.Option("--wait", help="Follow the scan to its end.")] = False,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Submit a scan again with changes; what they do not touch is not computed again."""
    document = read_changes(changes)
    with service(url, key) as client:
        scan = client.fork(scan_id, document)
        if wait:
            scan = follow(client, scan.id, quiet=as_json)
    show_scan(scan, as_json=as_json, brief=not wait)


@app.command(epilog="Example: nerfmodal scans upload captures/fern")
def upload(
    folder: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="Pictures and transforms.json.")],
    clouds: Annotated[bool, typer.Option("--clouds", help="The folder holds point clouds.")] = False,
    name: Annotated[str | None, typer.Option(help="What the capture is called.", show_default="folder")] = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Send a folder to the service and print what a specification's source.path names it by; goes on after a break."""
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    with service(url, key) as client, byte_bar(size, quiet=as_json) as arrived:
        capture = client.upload(folder, kind="clouds" if clouds else "capture", name=name, on_bytes=arrived)
    if as_json:
        print_json(dataclasses.asdict(capture))
    else:
        typer.echo(capture.source["path"])


@app.command(epilog="Example: nerfmodal scans logs 0190c0de-0000-7000-8000-000000000000")
def logs(
    scan_id: ScanId,
    after: Annotated[int, typer.Option(min=0, help="Only lines behind this one.")] = 0,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Print what the steps of a scan wrote."""
    with service(url, key) as client:
        lines = list(client.iterate_logs(scan_id, after=after))
    if as_json:
        print_json([{**dataclasses.asdict(line), "at": line.at.isoformat() if line.at else None} for line in lines])
        return
    for line in lines:
        frame = "" if line.frame is None or line.frame < 0 else f" {line.frame}"
        typer.echo(f"{line.at:%H:%M:%S} {line.step or ''}{frame}: {line.text}" if line.at else line.text)


@app.command(epilog="Example: nerfmodal scans delete 0190c0de-0000-7000-8000-000000000000")
def delete(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Forget a scan that has ended, with its files."""
    with service(url, key) as client:
        client.delete(scan_id)
    if as_json:
        print_json({"deleted": scan_id})


@app.command(epilog="Example: nerfmodal scans modes 0190c0de-0000-7000-8000-000000000000 --json")
def modes(scan_id: ScanId, url: Url = None, key: Key = None, as_json: Json = False) -> None:
    """Print the modes of a scan."""
    with service(url, key) as client:
        document = client.modes(scan_id)
    if as_json:
        print_json(document)
    else:
        results().print(modes_table(document))


@app.command(epilog="Example: nerfmodal scans download 0190c0de-0000-7000-8000-000000000000 --out out/scan")
def download(
    scan_id: ScanId,
    out: Annotated[Path | None, typer.Option("--out", help="Folder.", show_default="out/SCAN")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Frames, checkpoints and clouds too.")] = False,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Fetch the files of a scan, checked by digest; what is there already is not fetched again."""
    from scanclient import is_result

    folder = out or Path("out") / scan_id
    with service(url, key) as client:
        files = client.download(scan_id, folder, select=(lambda _: True) if everything else is_result)
    if as_json:
        print_json({"out": str(folder), "files": [str(path.relative_to(folder)) for path in files]})
    else:
        results().print(f"{len(files)} files in {folder}")


def follow(client: "Client", scan_id: str, *, quiet: bool) -> "Scan":
    """Wait for a scan, with bars on a terminal."""
    with scan_bars(quiet=quiet) as bars:
        return client.wait(scan_id, on_progress=lambda seen: bars(seen.progress, seen.eta_s))


def show_scan(scan: "Scan", *, as_json: bool, brief: bool = False) -> None:
    """Print a scan: its id alone, or what is known of it."""
    if as_json:
        print_json(document_of(scan))
    elif brief:
        typer.echo(scan.id)
    else:
        _print_scan(scan)


def document_of(scan: "Scan") -> dict[str, Any]:
    """A scan as JSON again."""
    document = dataclasses.asdict(dataclasses.replace(scan, client=None))
    del document["client"]
    return {key: value.isoformat() if isinstance(value, datetime) else value for key, value in document.items()}


def _print_scan(scan: "Scan") -> None:
    console = results()
    again = f"  generation {scan.generation}" if scan.generation else ""
    console.print(f"{scan.id}  {scan.name}  {scan.status}{again}")
    if scan.eta_s is not None:
        console.print(f"about {duration(scan.eta_s)} left")
    if scan.error is not None:
        reason = f"{scan.error.step}: {scan.error.message} {scan.error.hint or ''} [{scan.error.code}]"
        console.print(reason, markup=False)
    columns = ("step", ">done", ">of", ">running", ">failed")
    rows = [(row.step, str(row.done), str(row.total), str(row.running), str(row.failed)) for row in scan.progress]
    console.print(table_of(columns, rows))


def _row(scan: "Scan") -> tuple[str, ...]:
    total = sum(row.total for row in scan.progress)
    share = sum(row.fraction * row.total for row in scan.progress) / total if total else 0.0
    created = f"{scan.created_at:%Y-%m-%d %H:%M:%S}"
    return scan.id, scan.name, scan.status, f"{100 * share:.0f} %", scan.plant or "–", " ".join(scan.tags), created
