"""Watching a fleet with known onsets: false alarms per plant and year, and how many scans a drift goes unseen.

    python -m benchmarks.fleet [--plants 200] [--days 100]

Plants of `scanjobs.monitoring.simulated`: three modes, two scans a day, heat, outliers, modes that are not found.
Frequencies go through the tracking and the charts as those of real scans do. Healthy plants give the false alarms (at
most one a plant: it counts until it has had one); others change by a known share within the scans that are printed, and
the delay is counted from the first scan that is touched at all. The charts are asked for 0.1 false alarms a plant and
year; the floor of 0.2 is twice that, because outliers are not normal. The floor of 4 scans is two days: water that is
missing for so long is still put right. Plants that grow (0.5 % of f in 100 days) are watched with `growth`, and once
without, to show what not saying so costs: those alarms are of a change that is there.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scanjobs.monitoring.drift import DAY_S, Drift, History, Wish, drift
from scanjobs.monitoring.simulated import Kind, Life, Nature, live, temperature
from scanjobs.monitoring.tracking import Seen, Tracks, track

FOLDER = Path("out/benchmarks")
PAUSE_S = 12 * 3600.0
ONSET = 40
"""The first scan of a drift."""
DRIFTS = ((-0.03, 1), (-0.03, 4), (0.03, 4), (-0.02, 4), (-0.05, 10))
"""Size of the change, and within how many scans it comes."""
GROWTH = 5e-5
"""Of ln f per day."""
PER_YEAR = "per plant and year"
BOUNDS: dict[bool, tuple[float | None, float | None]] = {True: (0.2, 0.1), False: (None, None)}
FLOORS = {(-0.03, 1): (4.0, 2.0), (-0.03, 4): (4.0, 3.0), (0.03, 4): (4.0, 3.0)}


@dataclass(frozen=True, slots=True)
class Row:
    """One figure; `floor` and `aim` are the most it may be."""

    what: str
    value: float
    unit: str
    floor: float | None = None
    aim: float | None = None


def main() -> None:
    """Print the table and write out/benchmarks/fleet.json."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--plants", type=int, default=200)
    options.add_argument("--days", type=int, default=100)
    asked = options.parse_args()
    began = time.perf_counter()
    scans = 2 * asked.days
    rows = false_alarms(asked.plants, scans)
    rows += false_alarms(asked.plants // 2, scans, growth=GROWTH, told=True)
    rows += false_alarms(asked.plants // 4, scans, growth=GROWTH, told=False)
    rows += delays(max(asked.plants // 4, 10))
    rows.append(Row("time of the benchmark", time.perf_counter() - began, "s"))
    for row in rows:
        bounds = "" if row.floor is None else f"   floor {row.floor:g}, aim {row.aim:g}"
        print(f"{row.what:<66} {row.value:8.3f} {row.unit}{bounds}")
    FOLDER.mkdir(parents=True, exist_ok=True)
    document = [{name: getattr(row, name) for name in ("what", "value", "unit", "floor", "aim")} for row in rows]
    (FOLDER / "fleet.json").write_text(json.dumps(document, indent=2) + "\n")


def false_alarms(plants: int, scans: int, *, growth: float = 0.0, told: bool = False) -> list[Row]:
    """Healthy plants watched until their first alarm or to the end."""
    alarms, years = 0, 0.0
    links = doubtful = tracks = 0
    for number in range(plants):
        found, joined = watched(life_of(number, scans, np.zeros(scans), growth=growth), Wish(growth=told))
        first = scans if found.finding is None else found.finding.detected
        alarms += found.finding is not None
        years += (first - Wish().reference_scans) * PAUSE_S / (365.25 * DAY_S)
        links += sum(len(course.keys) for course in joined.courses)
        doubtful += sum(place.link == "doubtful" for place in joined.placed.values())
        tracks += len(joined.courses)
    if growth:
        return [
            Row(
                f"alarms of plants that grow, {'told' if told else 'not told'}", alarms / years, PER_YEAR, *BOUNDS[told]
            )
        ]
    return [
        Row("false alarms", alarms / years, PER_YEAR, *BOUNDS[True]),
        Row("plant-years watched", years, "years"),
        Row("tracks of a plant of three modes", tracks / plants, "tracks", floor=3.05, aim=3.0),
        Row("links that are marked doubtful", 100.0 * doubtful / links, "%"),
    ]


def delays(plants: int) -> list[Row]:
    """Plants that drift from scan `ONSET` on."""
    rows: list[Row] = []
    for size, within in DRIFTS:
        found = [delay_of(1000 + number, size, within) for number in range(plants)]
        seen = [delay for delay in found if delay > 0]
        floor, aim = FLOORS.get((size, within), (None, None))
        name = f"{100 * size:+g} % within {within} scan{'s' if within > 1 else ''}"
        rows.append(Row(f"{name}: delay, median", float(np.median(seen)), "scans", floor=floor, aim=aim))
        rows.append(Row(f"{name}: delay, 9 of 10 plants", float(np.percentile(seen, 90)), "scans"))
        rows.append(Row(f"{name}: alarms before the onset", float(sum(delay <= 0 for delay in found)), "plants"))
    return rows


def delay_of(number: int, size: float, within: int) -> float:
    """Scans from the onset to the alarm, the onset's own included; 0 for one before it, infinite for none."""
    scans = ONSET + 30
    share = np.clip((np.arange(scans) - ONSET + 1) / within, 0.0, 1.0)
    kind = Kind(drying=(np.log1p(size),) * 3)
    found, _ = watched(life_of(number, scans, share, kind))
    if found.finding is None:
        return float("inf")
    return max(found.finding.detected - ONSET + 1, 0)


def life_of(number: int, scans: int, dryness: np.ndarray, kind: Kind | None = None, growth: float = 0.0) -> Life:
    """The life of plant `number`."""
    rng = np.random.default_rng([20, number])
    at = 1.7e9 + PAUSE_S * np.arange(scans)
    nature = Nature(growth_per_day=growth)
    return live(at, temperature(at, rng), dryness, rng=rng, kind=kind, nature=nature)


def watched(life: Life, wish: Wish | None = None) -> tuple[Drift, Tracks]:
    """Tracked and charted as the service does."""
    scans = [_seen(life, k) for k in range(len(life.at))]
    joined = track(scans, {})
    shape = len(life.at), len(joined.courses)
    frequencies, stds = np.full(shape, np.nan), np.full(shape, np.nan)
    for mode in (mode for scan in scans for mode in scan):
        course = joined.placed[mode.key].course
        if course is not None:
            frequencies[int(mode.key[0]), course], stds[int(mode.key[0]), course] = mode.frequency, mode.std
    history = History(life.at, frequencies, stds, {"temperature_c": life.temperature_c})
    return drift(history, wish or Wish()), joined


def _seen(life: Life, k: int) -> Sequence[Seen]:
    modes = np.flatnonzero(np.isfinite(life.frequencies[k]))
    return [
        Seen(
            key=(str(k), Kind().organs[mode], int(mode)),
            at=float(life.at[k]),
            frequency=float(life.frequencies[k, mode]),
            std=float(life.stds[k, mode]),
        )
        for mode in modes
    ]


if __name__ == "__main__":
    main()
