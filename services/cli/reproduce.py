"""`reproduce paper`: the paper's experiment through the service, beside its truth. A run that is killed goes on.

Without --url a service is started for it, whose folder `OUT/.service` is kept until everything is done: started again,
the command finds its scans there (the specification's digest is their Idempotency-Key) and waits for what is left.
"""

import json
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from nerfmodal import __version__
from nerfmodal.errors import InvalidInput, MissingExtra
from nerfmodal.spec import RigSpec, ScanSpec, SimulationSource

from services.api.presets import DEFAULT, PRESETS
from services.cli.address import Url, withdraw
from services.cli.doctor import machine
from services.cli.output import Json, notes, number, percent, print_json, results, table_of
from services.cli.progress import duration, scan_bars
from services.cli.scans import Key
from services.cli.service_process import running_service
from services.cli.specs import as_json as json_of

if TYPE_CHECKING:
    from nerfmodal.types import Frame
    from scanclient import Client, Scan

Scale = Literal["small", "full"]
Document = dict[str, Any]
EXPERIMENTS = ("paper", "paper-off-bin", "paper-coupled")
BY_DEFAULT = ["paper", "paper-off-bin"]
POLL_S = 0.5
PREDECESSOR_S = 30.0
"""A service ends within 20 s of its parent."""
PORTRAIT = RigSpec(cameras=4, width_px=600, height_px=800, lowest_deg=5, highest_deg=30)
PORTRAIT_SAMPLES = 32
"""Of Figure 4: the plant at rest, large, from several sides."""
app = typer.Typer(help="Run a published experiment again, beside its truth.", no_args_is_help=True)


@app.callback()
def group() -> None:
    """Run a published experiment again, beside its truth."""


@app.command(epilog="Example: nerfmodal reproduce paper --scale small --out out/reproduction")
def paper(
    scale: Annotated[Scale, typer.Option(help="small: two cores, an hour; full: the paper's sizes.")] = "small",
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/reproduction"),
    spec: Annotated[
        list[str] | None, typer.Option("--spec", help=f"One of {', '.join(EXPERIMENTS)}; may be repeated.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything that is drawn by chance.")] = 0,
    renderer: Annotated[
        Literal["blender", "preview"], typer.Option(help="preview ray-casts: rougher pictures, sooner.")
    ] = "blender",
    frames: Annotated[int | None, typer.Option(min=16, help="Fewer frames, for a trial.")] = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Film the palm, reconstruct it, identify its modes, and print paper, truth and ours side by side.

    Writes reproduction.json, the paper's Figures 4 to 9 and an animation of each mode. Started again with the same
    options it goes on where it was.
    """
    names = spec or BY_DEFAULT
    specs = [experiment(name, scale, seed, renderer, frames) for name in names]
    command = _command(scale, names, seed, renderer, frames)
    out.mkdir(parents=True, exist_ok=True)
    stored = _begun(out, command, {one.digest() for one in specs})
    with _service(out, url, key) as client:
        for one in specs:
            if not any(done["spec_digest"] == one.digest() for done in stored["experiments"]):
                stored["experiments"].append(_run(client, one, out / one.name, quiet=as_json))
                _keep(stored, out)
    shutil.rmtree(out / ".service", ignore_errors=True)
    _show(stored, out, as_json=as_json)


def experiment(name: str, scale: Scale, seed: int, renderer: str, frames: int | None) -> ScanSpec:
    """The specification of an experiment at a scale. Raises `InvalidInput` for a name that is none.

    Small keeps the paper's record and motion, and takes rig and reconstruction from the demo, which follows the motion.
    """
    if name not in EXPERIMENTS:
        raise InvalidInput(f"is no experiment: '{name}'.", where="--spec", hint=f"Use one of {', '.join(EXPERIMENTS)}.")
    spec = PRESETS[name]
    assert isinstance(spec.source, SimulationSource)
    assert isinstance(DEFAULT.source, SimulationSource)
    changes: Document = {"renderer": renderer, "frames": frames or spec.source.frames}
    reconstruction = spec.reconstruction
    if scale == "small":
        changes |= {"rig": DEFAULT.source.rig, "samples": DEFAULT.source.samples}
        reconstruction = DEFAULT.reconstruction
    source = spec.source.model_copy(update=changes)
    return spec.model_copy(update={"source": source, "reconstruction": reconstruction, "seed": seed})


@contextmanager
def _service(out: Path, url: str | None, key: str | None) -> Iterator["Client"]:
    from scanclient import Client

    if url is not None:
        with Client(url, key=key) as client:
            yield client
        return
    data_folder = out / ".service"
    data_folder.mkdir(parents=True, exist_ok=True)
    _await_predecessor(data_folder)
    with running_service(data_folder, out / "service.log") as service, Client(service.address) as client:
        notes().print(f"service at {service.address}, its folder {data_folder}")
        yield client


def _await_predecessor(data_folder: Path) -> None:
    """The service of a run that was killed ends by itself; only then is its folder free, and its address void."""
    from scanjobs.errors import DataFolderInUse

    from services.worker.app import only_server

    deadline = time.monotonic() + PREDECESSOR_S
    while True:
        try:
            with only_server(data_folder):
                withdraw(data_folder)
                return
        except DataFolderInUse:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


def _run(client: "Client", spec: ScanSpec, out: Path, *, quiet: bool) -> Document:
    """One experiment: submitted (or found again), waited for, fetched, scored and drawn."""
    from nerfmodal import io
    from nerfmodal.reproduction import experiment_document, paper_figures, score

    notes().print(f"{spec.name}: {spec.digest()[:16]}")
    with scan_bars(quiet=quiet, lines=True) as show:
        scan = submitted(client, spec)
        scan = client.wait(scan.id, on_progress=lambda seen: show(seen.progress, seen.eta_s), poll_s=POLL_S)
        client.download(scan.id, out)
    result, truth = io.read_result(out / "result.npz"), io.read_truth(out / "truth.npz")
    modes, organs = score(result, truth)
    paper_figures(result, _portrait(spec), out / "figures", out / "paper")
    began, ended = scan.started_at, scan.finished_at
    seconds = (ended - began).total_seconds() if began and ended else 0.0
    return experiment_document(spec, result, modes, organs, seconds)


def submitted(client: "Client", spec: ScanSpec) -> "Scan":
    """The scan of this specification: a new one, the one that an earlier run began, or that one tried again."""
    scan = client.submit(json_of(spec), f"reproduce-{spec.digest()}")
    return client.retry(scan.id) if scan.status in ("failed", "canceled") else scan


def _portrait(spec: ScanSpec) -> "Frame | None":
    """The plant at rest, large; None where this machine cannot render and only fetched what another one did."""
    from nerfmodal import pipeline

    assert isinstance(spec.source, SimulationSource)
    source = spec.source.model_copy(update={"rig": PORTRAIT, "samples": PORTRAIT_SAMPLES, "frames": 1, "motion": ()})
    try:
        return pipeline.make_frame(spec.model_copy(update={"source": source}), 0, report=lambda _: None)
    except MissingExtra as error:
        notes().print(f"Figure 4 is left out: {error}")
        return None


def _begun(out: Path, command: str, wanted: set[str]) -> Document:
    """What an earlier run of the same command has stored of these specifications, or a new document."""
    path = out / "reproduction.json"
    if path.is_file():
        stored: Document = json.loads(path.read_text())
        if stored["command"] == command and stored["version"] == __version__:
            kept = [one for one in stored["experiments"] if one["spec_digest"] in wanted]
            return stored | {"resumed": True, "experiments": kept}
    return {
        "command": command,
        "version": __version__,
        "machine": {key: value for key, value in machine().items() if key != "free_disk_gib"},
        "seconds": 0.0,
        "resumed": (out / ".service").exists(),
        "experiments": [],
    }


def _keep(stored: Document, out: Path) -> None:
    from nerfmodal import io

    stored["seconds"] = round(sum(one["seconds"] for one in stored["experiments"]), 1)
    with io.atomic_write(out / "reproduction.json") as temporary:
        temporary.write_text(json.dumps(stored, indent=1) + "\n")


def _command(scale: Scale, names: Sequence[str], seed: int, renderer: str, frames: int | None) -> str:
    """The command as it would be typed, without where it writes."""
    words = ["nerfmodal reproduce paper --scale", scale]
    words += [f"--spec {name}" for name in names] if list(names) != BY_DEFAULT else []
    words += [f"--seed {seed}"]
    words += [f"--renderer {renderer}"] if renderer != "blender" else []
    words += [f"--frames {frames}"] if frames else []
    return " ".join(words)


MODES = ("organ", "shape", ">paper Hz", ">truth Hz", ">ours Hz", ">truth ζ", ">ours ζ", ">MAC", "verdict")
ORGANS = ("organ", ">active: paper", ">truth", ">ours", ">displacement error")
GOALS = ("goal", ">reached", ">wanted", "")


def _show(stored: Document, out: Path, *, as_json: bool) -> None:
    from nerfmodal.reproduction import goals_of

    if as_json:
        print_json(stored | {"goals": {one["name"]: goals_of(one) for one in stored["experiments"]}})
        return
    console = results()
    for one in stored["experiments"]:
        console.print(f"\n{one['name']}: {duration(one['seconds'])}")
        console.print(table_of(MODES, [_mode_row(row) for row in one["modes"]]))
        console.print()
        console.print(table_of(ORGANS, [_organ_row(row) for row in one["organs"]]))
        console.print()
        console.print(table_of(GOALS, [_goal_row(goal) for goal in goals_of(one)]))
    console.print(f"\nIn {out}: reproduction.json, and of each experiment paper/figure_4 … figure_9 and animations.")


def _mode_row(row: Document) -> tuple[str, ...]:
    return (
        row["organ"],
        row["shape"] or "–",
        number(row["paper_hz"], 0),
        number(row["truth_hz"], 2),
        number(row["found_hz"], 3),
        percent(row["truth_damping"]),
        percent(row["found_damping"]),
        number(row["mac"], 3),
        row["verdict"] or "not found",
    )


def _organ_row(row: Document) -> tuple[str, ...]:
    return (
        row["organ"],
        number(row["paper_active_eigenvalues"], 0),
        str(row["truth_active_eigenvalues"]),
        str(row["active_eigenvalues"]),
        percent(row["displacement_error"], 1),
    )


def _goal_row(goal: Document) -> tuple[str, ...]:
    return (
        goal["what"],
        f"{goal['reached']:.3g} {goal['unit']}",
        f"{goal['goal']:.3g} {goal['unit']}",
        "met" if goal["met"] else "missed",
    )
