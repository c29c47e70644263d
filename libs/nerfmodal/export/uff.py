"""Modes as a universal file (`modes.uff`), the format that modal-analysis software reads.

ASCII, fixed columns; data sets 151 (header), 164 (units: SI), 15 (nodes), 82 (lines between neighbouring nodes), 55
(mode shapes) and 58 (modal coordinates), as the Structural Dynamics Research Laboratory of the University of Cincinnati
documents them. Nodes are the sensors of all organs, numbered from 1 through the scan; a set 82 or 55 holds the nodes of
its own organ. Shapes in world x, y, z.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.geometry.skins import edges, rod_order, sheet_triangles
from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult, Provenance, ScanResult

SEPARATOR = "    -1"
SI, ABSOLUTE_TEMPERATURE = 1, 1
STRUCTURAL, NORMAL_MODE, TRANSLATIONS, DISPLACEMENT, REAL = 1, 2, 2, 8, 2
TIME_RESPONSE, DOUBLE, TIME = 1, 4, 17
EVEN_SPACING, UNEVEN_SPACING = 1, 0
EVENNESS = 1e-6
"""Frame intervals that differ by less than this share of a frame are even."""


def write_uff(result: ScanResult, name: str, path: Path) -> Path:
    """Write every mode of every organ; `name` is the scan's."""
    with atomic_write(path) as temporary, temporary.open("w", encoding="ascii", errors="replace") as file:
        for lines in _sets(result, name):
            file.write(_framed(lines))
    return path


def _sets(result: ScanResult, name: str) -> Iterator[list[str]]:
    """One data set after the other: those of many sensors are never all in memory."""
    yield _header(name, result.provenance)
    yield _units()
    yield _nodes(result)
    for place, (organ, numbers) in enumerate(_numbered(result), start=1):
        yield _trace(organ, place, numbers)
    for organ, numbers in _numbered(result):
        for k in range(len(organ.model.frequencies)):
            yield _shape(organ, k, numbers)
            yield _coordinate(organ, k, numbers)


def _framed(lines: list[str]) -> str:
    return "\n".join([SEPARATOR, *lines, SEPARATOR]) + "\n"


def _numbered(result: ScanResult) -> Iterator[tuple[OrganResult, Int[np.ndarray, " sensors"]]]:
    first = 1
    for organ in result.organs:
        count = len(organ.displacement.sensors.positions)
        yield organ, np.arange(first, first + count)
        first += count


def _header(name: str, provenance: Provenance) -> list[str]:
    date, _, clock = provenance.finished.partition("T")
    moment = f"{date[2:10]:<10}{clock[:8]:<10}"
    program = f"nerfmodal {provenance.package_version}"
    return [
        "   151",
        name[:80],
        f"specification {provenance.spec_digest}"[:80],
        program,
        f"{moment}{0:10d}{0:10d}{0:10d}",
        moment,
        program,
        moment,
    ]


def _units() -> list[str]:
    factors = "".join(f"{factor:25.17E}".replace("E", "D") for factor in (1.0, 1.0, 1.0))
    offset = f"{273.15:25.17E}".replace("E", "D")
    return ["   164", f"{SI:10d}{'SI: metre, newton':<20}{ABSOLUTE_TEMPERATURE:10d}", factors, offset]


def _nodes(result: ScanResult) -> list[str]:
    lines = ["    15"]
    for organ, numbers in _numbered(result):
        rows = zip(numbers, organ.displacement.sensors.positions, strict=True)
        lines += [f"{number:10d}{0:10d}{0:10d}{0:10d}{_reals(place)}" for number, place in rows]
    return lines


def _trace(organ: OrganResult, place: int, numbers: Int[np.ndarray, " sensors"]) -> list[str]:
    """The lines that draw the organ: nodes joined in this order, a 0 lifts the pen."""
    path = _pen(organ, numbers)
    rows = ["".join(f"{number:10d}" for number in path[at : at + 8]) for at in range(0, len(path), 8)]
    return ["    82", f"{place:10d}{len(path):10d}{0:10d}", organ.organ[:80], *rows]


def _pen(organ: OrganResult, numbers: Int[np.ndarray, " sensors"]) -> Int[np.ndarray, " steps"]:
    positions = organ.displacement.sensors.positions
    if organ.surface == "cylinder":
        return numbers[rod_order(positions)]
    pairs = numbers[edges(sheet_triangles(positions))]
    return np.column_stack([pairs, np.zeros(len(pairs), dtype=pairs.dtype)]).ravel()


def _shape(organ: OrganResult, k: int, numbers: Int[np.ndarray, " sensors"]) -> list[str]:
    model = organ.model
    motion = model.mode_shapes[:, :, k] @ organ.displacement.directions
    numbers_of_mode = np.array([model.frequencies[k], 0.0, model.damping_ratios[k], 0.0])
    lines = [
        "    55",
        f"{organ.organ} mode {k}, {model.quality[k].verdict.value}"[:80],
        "unit_max: largest component 1 along the organ's own directions",
        *["NONE"] * 3,
        f"{STRUCTURAL:10d}{NORMAL_MODE:10d}{TRANSLATIONS:10d}{DISPLACEMENT:10d}{REAL:10d}{3:10d}",
        f"{2:10d}{4:10d}{0:10d}{k + 1:10d}",
        _reals(numbers_of_mode),
    ]
    for number, vector in zip(numbers, motion, strict=True):
        lines += [f"{number:10d}", _reals(vector)]
    return lines


def _coordinate(organ: OrganResult, k: int, numbers: Int[np.ndarray, " sensors"]) -> list[str]:
    """The modal coordinate in metres: what the mode alone displaces where its shape is 1. Lost frames are left out."""
    seen = organ.displacement.valid
    times, values = organ.displacement.times[seen], organ.model.coordinates[seen, k]
    spacing, start, step = _spacing(times)
    largest = int(np.argmax(np.abs(organ.model.mode_shapes[:, :, k]).max(axis=1)))
    node = numbers[largest]
    return [
        "    58",
        f"{organ.organ} mode {k}, modal coordinate"[:80],
        *["NONE"] * 4,
        f"{TIME_RESPONSE:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{node:10d}{0:4d} {'NONE':<10}{0:10d}{0:4d}",
        f"{DOUBLE:10d}{len(values):10d}{spacing:10d}{start:13.5E}{step:13.5E}{0.0:13.5E}",
        _axis(TIME, 0, "Time", "s"),
        _axis(DISPLACEMENT, 1, "Displacement", "m"),
        _axis(0, 0, "NONE", "NONE"),
        _axis(0, 0, "NONE", "NONE"),
        *_values(times, values, spacing),
    ]


def _spacing(times: Float[np.ndarray, " frames"]) -> tuple[int, float, float]:
    steps = np.diff(times)
    if steps.size and np.ptp(steps) <= EVENNESS * steps.mean():
        return EVEN_SPACING, float(times[0]), float(steps.mean())
    return UNEVEN_SPACING, 0.0, 0.0


def _values(times: Float[np.ndarray, " frames"], values: Float[np.ndarray, " frames"], spacing: int) -> list[str]:
    """Four values a line, or two pairs of instant and value where the spacing is uneven."""
    if spacing == EVEN_SPACING:
        return ["".join(f"{value:20.12E}" for value in values[at : at + 4]) for at in range(0, len(values), 4)]
    pairs = [f"{instant:13.5E}{value:20.12E}" for instant, value in zip(times, values, strict=True)]
    return ["".join(pairs[at : at + 2]) for at in range(0, len(pairs), 2)]


def _axis(kind: int, length_exponent: int, name: str, unit: str) -> str:
    return f"{kind:10d}{length_exponent:5d}{0:5d}{0:5d} {name:<20} {unit:<20}"


def _reals(values: Float[np.ndarray, " values"]) -> str:
    return "".join(f"{value:13.5E}" for value in values)
