"""`preflight`: what a scan can and cannot find, and what it will cost, before anything runs."""

import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from nerfmodal.errors import InvalidInput
from nerfmodal.preflight import ExpectedMode, Pace, Preflight, Seen, preflight
from nerfmodal.spec import CaptureSource, CloudsSource, ScanSpec, SimulationSource

from services.cli.address import Url
from services.cli.certificate import read_certificate
from services.cli.output import Json, number, percent, print_json, results, table_of
from services.cli.progress import duration
from services.cli.scans import Key, service
from services.cli.specs import SpecFile, located, read_spec

REFUSED = 3
Modes = Annotated[
    list[str] | None,
    typer.Option("--mode", metavar="HZ:DAMPING:MM", help="A mode you expect; may be repeated.", show_default=False),
]
NoiseMm = Annotated[
    float | None, typer.Option(help="Noise of a fitted surface in one frame, mm.", min=1e-6, show_default=False)
]
CertificateFile = Annotated[
    Path | None, typer.Option(help="The rig's certificate.json: its noise is taken.", show_default=False)
]
Document = dict[str, Any]


def look_ahead(
    spec_file: SpecFile,
    mode: Modes = None,
    noise_mm: NoiseMm = None,
    certificate: CertificateFile = None,
    url: Url = None,
    key: Key = None,
    as_json: Json = False,
) -> None:
    """Say what a scan can and cannot find, and what it will cost, before anything runs; exit code 3 where it refuses.

    A capture or a record of clouds is opened to count its frames. With --url the service is asked instead: it knows
    how long its past steps took.
    """
    spec = read_spec(spec_file)
    if url is not None:
        with service(url, key) as client:
            answer = client.preflight(located(spec), modes=mode or (), noise_mm=noise_mm)
    else:
        answer = asdict(_here(spec, mode or [], noise_mm, certificate))
    if as_json:
        print_json(answer)
    else:
        _show(answer)
    if answer["verdict"] == "refuse":
        raise typer.Exit(REFUSED)


def _here(spec: ScanSpec, modes: list[str], noise_mm: float | None, certificate: Path | None) -> Preflight:
    seen, pixels = _look_inside(spec)
    noise = None if noise_mm is None else noise_mm / 1000
    expected = [_expected(text) for text in modes]
    pace = Pace(slots=os.cpu_count() or 1)
    noise_per_grain = None if certificate is None else read_certificate(certificate)["noise_per_grain"]
    return preflight(
        spec, seen=seen, expected=expected, noise=noise, noise_per_grain=noise_per_grain, pixels=pixels, pace=pace
    )


def _look_inside(spec: ScanSpec) -> tuple[Seen | None, int | None]:
    """What the source says of its record and cameras; a simulation that cannot be is refused here."""
    from nerfmodal import pipeline

    match spec.source:
        case SimulationSource():
            pipeline.check_source(spec)
            return None, None
        case CloudsSource():
            record = pipeline.open_clouds(spec)
            return Seen(frames=len(record), frame_rate=record.frame_rate), None
        case CaptureSource():
            return _look_at_capture(spec)


def _look_at_capture(spec: ScanSpec) -> tuple[Seen, int]:
    from nerfmodal import pipeline
    from nerfmodal.geometry.cameras import focus_of

    opened = pipeline.open_source(spec, report=lambda _: None)
    assert opened is not None
    assert isinstance(spec.source, CaptureSource)
    times, cameras = opened.times, opened.rig.cameras
    _, distance = focus_of(opened.rig)
    focal = min(max(camera.focal_x, camera.focal_y) for camera in cameras) / spec.source.downscale
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 1.0
    pixels = sum(camera.width * camera.height for camera in cameras) // spec.source.downscale**2
    seen = Seen(frames=len(times), frame_rate=rate, cameras=len(cameras), distance=distance, footprint=distance / focal)
    return seen, pixels


def _expected(text: str) -> ExpectedMode:
    try:
        return ExpectedMode.parse(text)
    except ValueError as error:
        raise InvalidInput(str(error), where="--mode") from error


def _show(answer: Document) -> None:
    console = results()
    for line in _facts(answer):
        console.print(line)
    rows = answer["modes"] or answer["resolves"]
    if rows:
        console.print()
        console.print(table_of(COLUMNS, [_row(row) for row in rows]))
    for finding in answer["findings"]:
        place = f"{finding['pointer']}: " if finding["pointer"] else ""
        console.print(f"\n{finding['severity']} {finding['code']}  {place}{finding['message']} {finding['hint']}")


COLUMNS = ("mode", ">Hz", ">damping", ">mm", ">over noise", ">± mHz", ">± damping", "found")


def _facts(answer: Document) -> list[str]:
    record, optics, cost = answer["record"], answer["optics"], answer["cost"]
    told = [f"verdict: {answer['verdict']}"]
    if record:
        told.append(
            f"record: {record['frames']} frames at {record['frame_rate_hz']:g} Hz, {record['duration_s']:.3g} s; "
            f"modes from {record['lowest_hz']:.3g} to {record['highest_hz']:.3g} Hz, "
            f"a Fourier bin is {record['bin_width_hz']:.3g} Hz; {answer['excitation'].replace('_', ' ')}"
        )
    if optics:
        told.append(
            f"optics: {optics['cameras']} cameras, a pixel covers {1e3 * optics['footprint_m']:.3g} mm at "
            f"{optics['distance_m']:.3g} m; noise of a frame {1e3 * optics['noise_m']:.3g} mm ({optics['noise_basis']})"
        )
    if cost:
        told.append(f"cost: {duration(cost['work_s'])} of work, {duration(cost['elapsed_s'])} on {cost['slots']} slots")
    return told


def _row(mode: Document) -> tuple[str, ...]:
    name = " ".join(part for part in (mode["organ"], mode["shape"]) if part) or "–"
    amplitude = mode["amplitude_m"]
    return (
        name,
        number(mode["frequency_hz"], 3),
        percent(mode["damping_ratio"]),
        number(None if amplitude is None else 1e3 * amplitude, 1),
        number(mode["amplitude_to_noise"], 1),
        number(None if mode["frequency_std_hz"] is None else 1e3 * mode["frequency_std_hz"], 2),
        percent(mode["damping_std"], 3),
        mode["found"],
    )
