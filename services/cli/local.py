"""The commands that compute in this process: run, simulate, reconstruct, identify. The science is imported on use."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from nerfmodal.errors import InvalidClouds
from nerfmodal.spec import CaptureSource, CloudsSource, OrganSpec, ScanSpec

from services.cli.output import Json, modes_table, notes, print_json, results
from services.cli.progress import stage_bars
from services.cli.specs import SpecFile, line_of, load, parse_spec, read_spec, read_text

if TYPE_CHECKING:
    from nerfmodal.io import CloudSequence
    from nerfmodal.types import PointCloud, ScanResult

SMALLEST_M, LARGEST_M = 0.003, 20.0
"""Organs beyond these lengths are remarked on: most often the unit of length is another than declared."""
SHOWN = 8
"""Names listed in a remark."""

Out = Annotated[Path | None, typer.Option("--out", help="Folder for what is written.", show_default="out/NAME")]
BaseSpec = Annotated[Path | None, typer.Option("--spec", help="A specification for the rest; its source is not used.")]
CaptureSpec = Annotated[
    Path | None, typer.Option("--spec", help="A specification for the rest; of a capture's source all but its path.")
]


def run(spec_file: SpecFile, out: Out = None, as_json: Json = False) -> None:
    """Run a whole scan in this process, without a service."""
    from nerfmodal import pipeline

    spec = read_spec(spec_file)
    folder = out or Path("out") / spec.name
    with stage_bars(quiet=as_json) as report:
        pipeline.run(spec, folder, report=report)
    show_results(folder, as_json=as_json)


def simulate(spec_file: SpecFile, out: Out = None, as_json: Json = False) -> None:
    """Film a simulated plant: images, transforms.json, and the truth that was imposed."""
    from services.cli.captures import write_capture

    spec = read_spec(spec_file)
    folder = out or Path("out") / spec.name
    with stage_bars(quiet=as_json) as report:
        frames = write_capture(spec, folder, report=report)
    _say(as_json, {"out": str(folder), "frames": frames}, f"{frames} frames in {folder}")


def reconstruct(
    capture: Annotated[Path, typer.Argument(help="Folder with pictures or videos.", show_default=False)],
    out: Out = None,
    spec_file: CaptureSpec = None,
    downscale: Annotated[int | None, typer.Option(min=1, max=64, help="Shrink pictures by this factor.")] = None,
    hold_out_every: Annotated[int | None, typer.Option(min=2, help="Keep every n-th view to measure the PSNR.")] = None,
    frame_rate: Annotated[float | None, typer.Option(help="Pictures per second, where nothing says it.")] = None,
    as_json: Json = False,
) -> None:
    """Turn a capture into point clouds (frame_0000.ply …, clouds.json) and metrics.json."""
    from services.cli.captures import reconstruct_capture

    given = {"downscale": downscale, "hold_out_every": hold_out_every, "frame_rate_hz": frame_rate}
    source = _capture_of(spec_file) | {"kind": "capture", "path": str(capture)}
    source |= {key: value for key, value in given.items() if value is not None}
    spec = spec_around(source, capture, spec_file)
    folder = out or Path("out") / spec.name
    with stage_bars(quiet=as_json) as report:
        metrics = reconstruct_capture(spec, folder, report=report)
    _say(as_json, {"out": str(folder), "frames": metrics}, f"{len(metrics)} clouds in {folder}")


def identify(
    clouds: Annotated[Path, typer.Argument(help="Folder of PLY files, or an .npz.", show_default=False)],
    out: Out = None,
    spec_file: BaseSpec = None,
    frame_rate: Annotated[float | None, typer.Option(help="Frames per second, where no clouds.json says it.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of length of the points: m, cm, mm, in …")] = None,
    as_json: Json = False,
) -> None:
    """Find the organs and their modes in a sequence of point clouds of any sensor."""
    from nerfmodal import pipeline

    source = {"kind": "clouds", "path": str(clouds), "frame_rate_hz": frame_rate, "unit": unit}
    spec = spec_around(source, clouds, spec_file)
    folder = out or Path("out") / spec.name
    with stage_bars(quiet=as_json) as report:
        record = pipeline.open_clouds(spec)
        read = pipeline.read_all(record, report=lambda now: report("read", now))
        with organs_located(spec, spec_file):
            result = pipeline.identify(spec, read, report=lambda now: report("identify", now))
    folder.mkdir(parents=True, exist_ok=True)
    pipeline.publish(spec, result, None, first_seen(read), folder)
    for remark in remarks(record, read, result):
        notes().print(remark)
    show_results(folder, as_json=as_json)


@contextmanager
def organs_located(spec: ScanSpec, spec_file: Path | None) -> Iterator[None]:
    """What is wrong with an organ names the line of the file that describes it, where there is one."""
    try:
        yield
    except InvalidClouds as error:
        names = [organ.name for organ in spec.organs if isinstance(organ, OrganSpec)]
        _, _, name, *rest = [*(error.where or "").split("/"), "", ""]
        if spec_file is None or name not in names:
            place = f"{getattr(spec.source, 'path', '')} {error.where or ''}".strip()
            raise InvalidClouds(error.message, where=place, hint=error.hint) from error
        pointer = "/".join(["", "organs", str(names.index(name)), *filter(None, rest)])
        line = line_of(read_text(spec_file), pointer)
        place = f"{spec_file}:{line} {pointer}" if line else f"{spec_file} {pointer}"
        raise InvalidClouds(error.message, where=place, hint=error.hint) from error


def first_seen(clouds: "Sequence[PointCloud]") -> "PointCloud | None":
    """The first cloud that has points; None where none has."""
    return next((cloud for cloud in clouds if len(cloud.points)), None)


def remarks(record: "CloudSequence", clouds: "Sequence[PointCloud]", result: "ScanResult") -> list[str]:
    """What a careful reader would ask about: gaps in the record, lost frames, a suspicious size."""
    found = []
    if record.missing:
        found.append(f"{_count(len(record.missing), 'frame')} missing by their numbers: {_some(record.missing)}.")
    empty = [name for name, cloud in zip(record.names, clouds, strict=True) if not len(cloud.points)]
    if empty:
        found.append(f"{_count(len(empty), 'frame')} without points: {_some(empty)}.")
    for organ in result.organs:
        lost = int((~organ.displacement.valid).sum()) - len(empty)
        if lost > 0:
            found.append(f"{organ.organ}: {_count(lost, 'frame')} with too few points on it.")
        places = organ.displacement.sensors.positions
        longest = float((places.max(axis=0) - places.min(axis=0)).max())
        if not SMALLEST_M < longest < LARGEST_M:
            found.append(f"{organ.organ} is {longest:.3g} m long: is the unit right? If not, give --unit mm, say.")
    return found


def _capture_of(spec_file: Path | None) -> dict[str, Any]:
    """What a specification says of its capture; nothing where its source is of another kind."""
    document: Any = load(read_text(spec_file), spec_file) if spec_file is not None else None
    source = document.get("source") if isinstance(document, dict) else None
    return dict(source) if isinstance(source, dict) and source.get("kind") == "capture" else {}


def spec_around(
    source: CaptureSource | CloudsSource | Mapping[str, Any], path: Path, spec_file: Path | None
) -> ScanSpec:
    """The specification of a file, or the defaults, with this source; named after `path` unless the file names it."""
    document: Any = {}
    text = ""
    if spec_file is not None:
        text = read_text(spec_file)
        document = load(text, spec_file) or {}
    if not isinstance(document, dict):
        return parse_spec(document, text, spec_file or path)  # raises: it is no object
    named = {"name": scan_name(path)} | document | {"source": _plain(source)}
    return parse_spec(named, text, spec_file or path)


def scan_name(path: Path) -> str:
    """A name that a specification takes, made from a path's last part."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", Path(path.resolve().name.lstrip(".")).stem).lstrip("_.-")[:64]
    return name or "scan"


def show_results(folder: Path, *, as_json: bool) -> None:
    """Print the modes that were published under `folder`."""
    document = json.loads((folder / "modes.json").read_text())
    if as_json:
        print_json({"out": str(folder), "modes": document})
        return
    console = results()
    console.print(modes_table(document))
    if document.get("outcome", "OK") != "OK":
        console.print(document["message"])
    console.print(f"Results in {folder}: report.html, modes.json")


def _plain(source: CaptureSource | CloudsSource | Mapping[str, Any]) -> Mapping[str, Any]:
    return source if isinstance(source, Mapping) else source.model_dump(mode="json")


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _some(items: Sequence[object]) -> str:
    return ", ".join(map(str, items[:SHOWN])) + (" …" if len(items) > SHOWN else "")


def _say(as_json: bool, document: dict[str, Any], text: str) -> None:
    if as_json:
        print_json(document)
    else:
        results().print(text)
