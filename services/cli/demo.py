"""`demo`: a scan through the real service — started for it, stopped after it — beside the truth that was imposed."""

import json
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from nerfmodal.spec import ScanSpec, SimulationSource

from services.cli.compare import Row, as_rows, comparison_table, rows_of
from services.cli.output import Json, notes, print_json, results
from services.cli.progress import duration, scan_bars
from services.cli.service_process import running_service
from services.cli.specs import located, read_spec

POLL_S = 0.5
SpecOption = Annotated[Path, typer.Option("--spec", help="A specification, YAML or JSON.")]
OutOption = Annotated[Path, typer.Option("--out", help="Folder for the results.")]


def demo(
    spec_file: SpecOption = Path("examples/acai.yaml"), out: OutOption = Path("out/demo"), as_json: Json = False
) -> None:
    """Start the service, send it a scan over HTTP, fetch the results, compare them with the truth, stop it."""
    spec = read_spec(spec_file)
    began = time.monotonic()
    files = _through_the_service(spec, out, quiet=as_json)
    rows = compare_with_truth(out, files)
    _show(rows, out, time.monotonic() - began, as_json=as_json)


def compare_with_truth(out: Path, files: Sequence[Path]) -> list[Row]:
    """Write comparison.json beside the results; it is empty where no truth is among the files."""
    truth = out / "truth.npz"
    rows = as_rows(rows_of(out / "result.npz", truth)) if truth in files else []
    (out / "comparison.json").write_text(json.dumps(rows, indent=2) + "\n")
    return rows


def captures_of(spec: ScanSpec) -> list[Path]:
    """The folder the service must be allowed to read."""
    return [] if isinstance(spec.source, SimulationSource) else [Path(spec.source.path).resolve().parent]


def _through_the_service(spec: ScanSpec, out: Path, *, quiet: bool) -> tuple[Path, ...]:
    """The downloaded files. The service's folder is removed, or named and kept where something went wrong.

    It lies beside `out`, as it may grow to gigabytes and the system's temporary folder may be memory.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    data_folder = Path(tempfile.mkdtemp(prefix=".demo-service-", dir=out.parent))
    try:
        with running_service(data_folder, data_folder / "service.log", captures_of(spec)) as service:
            if not quiet:
                notes().print(f"service at {service.address}, its folder {data_folder}")
            files = _scan(service.address, spec, out, quiet=quiet)
    except BaseException:
        notes().print(f"What the service wrote is kept in {data_folder}")
        raise
    shutil.rmtree(data_folder)
    return files


def _scan(address: str, spec: ScanSpec, out: Path, *, quiet: bool) -> tuple[Path, ...]:
    from scanclient import Client

    with Client(address) as client, scan_bars(quiet=quiet, lines=True) as show:
        scan = client.submit(located(spec))
        client.wait(scan.id, on_progress=lambda seen: show(seen.progress, seen.eta_s), poll_s=POLL_S)
        return client.download(scan.id, out)


def _show(rows: list[Row], out: Path, seconds: float, *, as_json: bool) -> None:
    if as_json:
        print_json({"out": str(out), "seconds": round(seconds, 1), "comparison": rows})
        return
    console = results()
    if rows:
        console.print(comparison_table(rows))
    console.print(f"\nTook {duration(seconds)}; nothing of the service is left running. In {out}:")
    for name, what in WHAT.items():
        if (out / name).exists():
            console.print(f"  {name:<16} {what}")


WHAT = {
    "report.html": "the pictures: views, cloud, eigenvalues, modal coordinates, spectra, shapes (open in a browser)",
    "modes.json": "frequencies, damping and verdicts with their standard deviations",
    "comparison.json": "the table above",
    "result.npz": "everything as arrays",
    "truth.npz": "what was imposed; only the comparison reads it",
}
