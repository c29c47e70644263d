"""A record of point clouds: a folder of PLY files (with a clouds.json) or one .npz.

`clouds.json` is {"frame_rate_hz", "times_s"?, "unit"?, "organs"?}; an .npz has the same keys beside `frame_0000`, ….
Strict where a wrong guess would pass unseen, generous elsewhere: files of any name are taken in natural order, a gap in
their numbers is a lost frame, and what the clouds.json lacks may be given beside it.
"""

import json
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pydantic import TypeAdapter, ValidationError

from nerfmodal.errors import InvalidClouds
from nerfmodal.io.clouds import checked, read_cloud, time_in
from nerfmodal.spec import OrganSpec
from nerfmodal.types import PointCloud

METRES = {
    "km": 1e3,
    "m": 1.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 0.001,
    "um": 1e-6,
    "in": 0.0254,
    "ft": 0.3048,
}
SPELT = {"metre": "m", "meter": "m", "centimetre": "cm", "centimeter": "cm", "millimetre": "mm", "millimeter": "mm"}
SPELT |= {f"{name}s": unit for name, unit in SPELT.items()}
SPELT |= {"µm": "um", "inch": "in", "inches": "in", "foot": "ft", "feet": "ft"}

NUMBERED = re.compile(r"^(.*?)(\d+)$")
LARGEST_GAPS = 3
"""Numbers that span more than this many times the files are no frame numbers (a date, a clock)."""
ODD_RATE = 10.0
"""Times whose usual step is off the frame rate by more than this factor are in another unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CloudSequence:
    """A record that was opened: everything but the points has been looked at.

    `missing` are the numbers that the frames' names skip: lost frames, which leave a gap in `times` (seconds).
    """

    path: Path
    frame_rate: float
    times: Float[np.ndarray, " frames"]
    names: tuple[str, ...]
    missing: tuple[int, ...]
    organs: tuple[OrganSpec, ...]
    read: Callable[[int], PointCloud]

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[PointCloud]:
        return (self.read(index) for index in range(len(self.names)))


def open_clouds(path: Path, *, frame_rate: float | None = None, unit: str | None = None) -> CloudSequence:
    """Open the clouds of a folder or an .npz, in the order of time.

    Parameters
    ----------
    frame_rate, unit
        What is known beside the files; both go before what the files say.

    Raises
    ------
    InvalidClouds
        At once for what concerns the whole; while reading for a broken cloud.
    """
    if path.is_dir():
        return _open_folder(path, frame_rate, unit)
    if path.suffix == ".npz" and path.is_file():
        return _open_npz(path, frame_rate, unit)
    raise InvalidClouds(
        "is neither a folder of PLY files nor an .npz." if path.exists() else "does not exist.",
        where=str(path),
        hint="Give a folder with frame_0000.ply … and clouds.json, or an .npz with frame_0000 … and frame_rate_hz.",
    )


def natural_key(name: str) -> tuple[Any, ...]:
    """Sorts `scan_2` before `scan_10`."""
    return tuple((int(part), part) if part.isdigit() else (-1, part.lower()) for part in re.split(r"(\d+)", name))


def _open_folder(path: Path, rate: float | None, unit: str | None) -> CloudSequence:
    every = [file for file in path.iterdir() if file.suffix.lower() == ".ply" and not file.name.startswith(".")]
    files = [file for file in every if file.stem.startswith("frame_")] or every
    files = sorted(files, key=lambda file: natural_key(file.stem))
    _refuse_none(len(files), path, "PLY files")
    document = _document(path / "clouds.json")
    scale = _scale(document, unit, f"{path / 'clouds.json'}#/unit")
    told = [time_in(file) for file in files]
    names = [file.stem for file in files]
    frame_rate, times, missing = _timing(document, rate, names, told, str(path / "clouds.json"))
    return CloudSequence(
        path=path,
        frame_rate=frame_rate,
        times=times,
        names=tuple(file.name for file in files),
        missing=missing,
        organs=_organs(document.get("organs"), f"{path / 'clouds.json'}#/organs"),
        read=lambda index: read_cloud(files[index], time=float(times[index]), scale=scale),
    )


def _open_npz(path: Path, rate: float | None, unit: str | None) -> CloudSequence:
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = [name for name in archive.files if re.fullmatch(r"frame_?\d+", name)]
            document = {
                name: archive[name].tolist() for name in ("frame_rate_hz", "times_s", "unit") if name in archive
            }
            organs = json.loads(str(archive["organs"])) if "organs" in archive else None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidClouds(f"cannot be read ({error}).", where=str(path), hint="Write it with numpy.savez.") from error
    names = sorted(found, key=natural_key)
    _refuse_none(len(names), path, "arrays frame_0000 …")
    scale = _scale(document, unit, f"{path}#/unit")
    frame_rate, times, missing = _timing(document, rate, names, [None] * len(names), str(path))
    return CloudSequence(
        path=path,
        frame_rate=frame_rate,
        times=times,
        names=tuple(names),
        missing=missing,
        organs=_organs(organs, f"{path}#/organs"),
        read=lambda index: _read_array(path, names[index], float(times[index]), scale),
    )


def _read_array(path: Path, name: str, time: float, scale: float) -> PointCloud:
    where = f"{path}#/{name}"
    try:
        with np.load(path, allow_pickle=False) as archive:
            points = checked(np.asarray(archive[name], dtype=float) * scale, where)
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidClouds(
            f"is no array of numbers ({error}).", where=where, hint="Store (points, 3) floats."
        ) from error
    return PointCloud(points=points, colors=np.full((len(points), 3), 0.5), time=time)


def _document(where: Path) -> dict[str, Any]:
    """The clouds.json; empty where there is none, so that its parts can be given on the command line."""
    if not where.exists():
        return {}
    try:
        document = json.loads(where.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise InvalidClouds(
            f"cannot be read ({error}).", where=str(where), hint='Write {"frame_rate_hz": …, "unit": "m"}.'
        ) from error
    if not isinstance(document, dict):
        raise InvalidClouds("is no JSON object.", where=str(where), hint='Write {"frame_rate_hz": …, "unit": "m"}.')
    return document


def _scale(document: Mapping[str, Any], given: str | None, where: str) -> float:
    """Metres in the unit of length that was declared; metres where none is."""
    unit = given if given is not None else document.get("unit", "m")
    name = str(unit).strip()
    name = SPELT.get(name.lower(), name.lower())
    if name not in METRES:
        raise InvalidClouds(f"has the unit {unit!r}.", where=where, hint=f"Use one of {', '.join(METRES)}.")
    return METRES[name]


def _timing(
    document: Mapping[str, Any],
    given_rate: float | None,
    names: Sequence[str],
    told: Sequence[float | None],
    where: str,
) -> tuple[float, np.ndarray, tuple[int, ...]]:
    """Frame rate (Hz), instants (seconds) and the numbers of lost frames."""
    places, missing = _places(names)
    listed = document.get("times_s")
    if listed is not None:
        times = _listed_times(listed, places, names, f"{where}#/times_s")
    elif all(time is not None for time in told) and len(set(told)) > 1:
        times = np.array(told, dtype=float)
        _refuse_disorder(times, names, str(Path(where).parent), "Name the files in the order of time.")
    else:
        return (rate := _rate(document, given_rate, where)), places / rate, missing
    if given_rate is None and document.get("frame_rate_hz") is None and len(times) > 1:
        return float(1.0 / np.median(np.diff(times))), times, missing
    rate = _rate(document, given_rate, where)
    _refuse_other_unit(times, rate, where)
    return rate, times, missing


def _places(names: Sequence[str]) -> tuple[np.ndarray, tuple[int, ...]]:
    """Where each frame stands in the record by the numbers in the names, and the numbers that are skipped."""
    order = np.arange(len(names))
    parts = [NUMBERED.match(name) for name in names]
    if len(names) < 2 or not all(parts) or len({part[1] for part in parts if part}) > 1:
        return order, ()
    numbers = np.array([int(part[2]) for part in parts if part], dtype=object)
    steps = np.diff(numbers)
    stride = int(np.gcd.reduce(steps))
    if stride == 0 or min(steps) <= 0 or (numbers[-1] - numbers[0]) // stride > LARGEST_GAPS * len(names):
        return order, ()
    places = ((numbers - numbers[0]) // stride).astype(int)
    skipped = np.setdiff1d(np.arange(places[-1] + 1), places)
    return places, tuple(int(numbers[0]) + stride * int(place) for place in skipped)


def _listed_times(value: Any, places: np.ndarray, names: Sequence[str], where: str) -> np.ndarray:
    try:
        times = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        times = np.array(np.nan)
    if times.ndim == 1 and len(times) == places[-1] + 1:
        times = times[places]  # the times of lost frames are listed too
    if times.shape != (len(names),):
        raise InvalidClouds(
            f"lists {times.size} times for {len(names)} clouds.", where=where, hint="Give one time (s) a cloud."
        )
    if not np.isfinite(times).all():
        raise InvalidClouds("a time is no number.", where=where, hint="Give one time (s) a cloud.")
    _refuse_disorder(times, names, where, "Put the clouds and their times in the order of time.")
    return times


def _refuse_disorder(times: np.ndarray, names: Sequence[str], where: str, hint: str) -> None:
    if (np.diff(times) > 0).all():
        return
    late = 1 + int(np.argmax(np.diff(times) <= 0))
    after, before = (f"{names[k]} is at {times[k]:g} s" for k in (late, late - 1))
    raise InvalidClouds(
        f"the times do not increase: {after}, {before}.",
        where=where,
        hint=hint,
    )


def _refuse_other_unit(times: np.ndarray, rate: float, where: str) -> None:
    usual = float(np.median(np.diff(times))) * rate if len(times) > 1 else 1.0
    if not 1 / ODD_RATE < usual < ODD_RATE:
        raise InvalidClouds(
            f"contradict each other: the frame rate is {rate:g} Hz, the times usually step {usual / rate:g} s.",
            where=f"{where}#/times_s",
            hint="Give the times in seconds and the frame rate in frames per second.",
        )


def _rate(document: Mapping[str, Any], given: float | None, where: str) -> float:
    value = document.get("frame_rate_hz") if given is None else given
    if value is None:
        raise InvalidClouds(
            "does not say the frame_rate_hz." if Path(where).exists() else "is missing: the frame rate is not known.",
            where=f"{where}#/frame_rate_hz",
            hint='Give --frame-rate 30, say, or write clouds.json: {"frame_rate_hz": 30, "unit": "m"}.',
        )
    try:
        rate = float(value)
    except (TypeError, ValueError):
        rate = 0.0
    if not (np.isfinite(rate) and rate > 0):
        raise InvalidClouds(
            f"the frame rate is {value!r}.",
            where=f"{where}#/frame_rate_hz" if given is None else "--frame-rate",
            hint="Give the frames per second, above 0.",
        )
    return rate


def _organs(value: Any, where: str) -> tuple[OrganSpec, ...]:
    if value is None:
        return ()
    try:
        organs = TypeAdapter(tuple[OrganSpec, ...]).validate_python(value)
    except ValidationError as error:
        first = error.errors()[0]
        place = "/".join(map(str, first["loc"]))
        raise InvalidClouds(
            f"{first['msg']}.", where=f"{where}/{place}", hint="Organs are written as in a specification."
        ) from error
    names = [organ.name for organ in organs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InvalidClouds(f"two organs are called {twice[0]!r}.", where=where, hint="Give each its own name.")
    return organs


def _refuse_none(count: int, path: Path, what: str) -> None:
    if count == 0:
        raise InvalidClouds(
            "holds no clouds.", where=str(path), hint=f"A record is {what}, named frame_0000 and so on."
        )
