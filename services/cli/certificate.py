"""`certify`: what a rig of cameras can see of motions that are known, as a document that later scans refer to."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from nerfmodal.errors import InvalidInput
from nerfmodal.preflight.certified import WHAT_WRITES_ONE, check_certificate
from nerfmodal.spec import CaptureSource, RigSpec, ScanSpec, SimulationSource
from pydantic import ValidationError

from services.cli.output import Json, notes, number, print_json, results, table_of
from services.cli.progress import stage_bars
from services.cli.specs import load, parse_spec, read_text

if TYPE_CHECKING:
    from nerfmodal.types import Rig

FILE_NAME = "certificate.json"
WHAT_A_RIG_IS = "Give a capture's folder, a specification with a simulation or a capture, or the keys of source.rig."
RigPlace = Annotated[
    Path,
    typer.Argument(metavar="RIG", help="A capture, a specification, or a file of rig keys.", show_default=False),
]
Document = dict[str, Any]


def certify(
    rig: RigPlace,
    out: Annotated[Path, typer.Option(help="Folder for certificate.json.")] = Path("out/certificate"),
    frame_rate: Annotated[
        float | None, typer.Option(min=1e-3, help="Frames a second, where RIG does not say it.", show_default=False)
    ] = None,
    frames: Annotated[int, typer.Option(min=32, help="Of the trial.")] = 48,
    noise_counts: Annotated[float, typer.Option(min=0, help="Noise of a pixel, in 8-bit counts.")] = 1.0,
    longest_px: Annotated[int, typer.Option(min=64, help="Larger pictures are shrunk to this for the trial.")] = 320,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise and of the board's colours.")] = 0,
    as_json: Json = False,
) -> None:
    """Film a board of known motions with this rig, and store the smallest that it sees and how well it reads them."""
    from nerfmodal import io
    from nerfmodal.certificate import Settings
    from nerfmodal.certificate import certify as try_rig

    cameras, rate = rig_of(rig)
    settings = Settings(
        frame_rate=frame_rate or rate or _no_rate(rig),
        frames=frames,
        noise_counts=noise_counts,
        longest_px=longest_px,
        seed=seed,
    )
    with stage_bars(quiet=as_json) as report:
        document = try_rig(cameras, settings, report=report)
    out.mkdir(parents=True, exist_ok=True)
    with io.atomic_write(out / FILE_NAME) as temporary:
        temporary.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")
    if as_json:
        print_json(document)
    else:
        _show(document, out)


def rig_of(path: Path) -> tuple["Rig", float | None]:
    """The cameras that a folder or file means, and their frame rate where it says one. Raises `InvalidInput`."""
    if path.is_dir():
        return _of_capture(CaptureSource(kind="capture", path=str(path)))
    text = read_text(path)
    document = load(text, path)
    if isinstance(document, dict) and "source" in document:
        return _of_spec(parse_spec(document, text, path), path)
    if isinstance(document, dict) and "frames" in document:
        return _of_capture(CaptureSource(kind="capture", path=str(path.parent)))
    return _of_keys(document, path), None


def read_certificate(path: Path) -> Document:
    """A stored certificate. Raises `InvalidInput` where the file is none."""
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InvalidInput(f"cannot be read ({error}).", where=str(path), hint=WHAT_WRITES_ONE) from error
    return check_certificate(document, str(path))


def _of_spec(spec: ScanSpec, path: Path) -> tuple["Rig", float | None]:
    from nerfmodal.geometry.cameras import semi_spherical_rig

    match spec.source:
        case SimulationSource():
            return semi_spherical_rig(spec.source.rig), spec.source.frame_rate_hz
        case CaptureSource():
            return _of_capture(spec.source)
        case _:
            raise InvalidInput("has no cameras.", where=str(path), hint=WHAT_A_RIG_IS)


def _of_capture(source: CaptureSource) -> tuple["Rig", float | None]:
    from nerfmodal import capture

    opened = capture.open_capture(source)
    times = opened.times
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else source.frame_rate_hz
    return opened.rig, rate


def _of_keys(document: Any, path: Path) -> "Rig":
    from nerfmodal.geometry.cameras import semi_spherical_rig

    try:
        return semi_spherical_rig(RigSpec.model_validate(document))
    except ValidationError as error:
        first = error.errors()[0]
        key = "/".join(str(part) for part in first["loc"])
        raise InvalidInput(f"/{key}: {first['msg']}.", where=str(path), hint=WHAT_A_RIG_IS) from error


def _no_rate(path: Path) -> float:
    raise InvalidInput("does not say its frame rate.", where=str(path), hint="Give --frame-rate.")


COLUMNS = (">Hz", ">detected", ">from mm", ">from px", ">bias mHz", ">± mHz at 1 px", ">± damping at 1 px")


def _show(document: Document, out: Path) -> None:
    console = results()
    console.print(
        f"{len(document['cameras'])} cameras at {document['frame_rate_hz']:g} Hz, tried at "
        f"{document['tried_width_px']} × {document['tried_height_px']} pixels: one covers "
        f"{1e3 * document['footprint_m']:.3g} mm at {document['distance_m']:.3g} m"
    )
    console.print(table_of(COLUMNS, [_row(one) for one in document["frequencies"]]))
    if document["noise_per_grain"] is not None:
        console.print(f"noise of a frame: {document['noise_per_grain']:.3g} of {1e3 * document['grain_m']:.3g} mm")
    if document["false_modes"]:
        notes().print(f"{document['false_modes']} modes were accepted that are not there.")
    console.print(f"\nrig {document['rig_digest']}\ncertificate {document['id']} in {out / FILE_NAME}")


def _row(one: Document) -> tuple[str, ...]:
    def thousand(key: str, digits: int) -> str:
        return number(None if one[key] is None else 1e3 * one[key], digits)

    damping = one["damping_spread_at_one_px"]
    return (
        number(one["frequency_hz"], 2),
        f"{one['detected']} of {one['tried']}",
        thousand("smallest_amplitude_m", 2),
        number(one["smallest_amplitude_px"], 2),
        thousand("bias_hz", 1),
        thousand("spread_hz_at_one_px", 1),
        "–" if damping is None else f"{100 * damping:.2f} %",
    )
