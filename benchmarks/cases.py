"""The public cases C01 to C10: the worst of all seeds."""

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from nerfmodal.identify.comparison import ComparisonRow, compare
from nerfmodal.types import Verdict

from benchmarks.rows import Row
from tests.fixtures.public_cases import CASES, GENERATOR, displacement_error, draw, identify_case


def case_rows(case: str, seeds: int) -> Iterator[Row]:
    """Rows of one case, if it can be drawn here."""
    if case != "C10" and not GENERATOR.exists():
        print(f"{case} is left out: no {GENERATOR}", file=sys.stderr)
        return
    tolerance = CASES[case]
    modes = len(tolerance.frequency)
    right, errors, displacement = 0, [], []
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as folder:
            drawn = draw(case, seed, Path(folder))
        result = identify_case(case, drawn.clouds)
        rows = [row for row in compare(result, drawn.truth) if row.verdict is Verdict.ACCEPTED]
        right += len(rows) == modes
        matched = [row for row in rows if row.truth_hz is not None]
        errors.append([_errors(row) for row in matched] if len(matched) == modes else None)
        if tolerance.displacement is not None:
            displacement.append(displacement_error(result.organs[0], drawn))
    yield Row(what=f"{case} count right", value=20 * right / seeds, unit="of 20", floor=tolerance.count_right, aim=20)
    complete = [each for each in errors if each is not None]
    for mode in range(modes if complete else 0):
        worst = [max(each[mode][part] for each in complete) for part in range(3)]
        limits = (tolerance.frequency[mode], tolerance.damping[mode], 1 - tolerance.mac[mode])
        for value, limit, name, unit in zip(
            worst, limits, ("frequency", "damping", "1 - MAC"), ("mHz", "pp", "-"), strict=True
        ):
            yield Row(what=f"{case} mode {mode + 1} {name} error", value=value, unit=unit, floor=limit, aim=limit / 2)
    if displacement:
        limit = tolerance.displacement or 0.0
        yield Row(what=f"{case} displacement error", value=max(displacement), unit="-", floor=limit, aim=limit / 2)


def _errors(row: ComparisonRow) -> tuple[float, float, float]:
    frequency = 1e3 * abs((row.found_hz or 0.0) - (row.truth_hz or 0.0))
    return frequency, 1e2 * abs((row.found_damping or 0.0) - (row.truth_damping or 0.0)), 1 - (row.mac or 0.0)
