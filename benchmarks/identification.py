"""How good the identification is, in numbers: `python -m benchmarks.identification [--only GROUP …] [--seeds N]`.

Prints a table and writes out/benchmarks/identification.json: rows of what, value, unit, floor (what it must at least
reach) and aim. Groups run one by one, each within minutes on one core; rows of groups that are not run again stay in
the file. A group that lacks something it needs says so and is left out.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from benchmarks.battery import battery_rows
from benchmarks.cases import case_rows
from benchmarks.limits import ambient_rows, bound_rows, coverage_rows, drift_rows, patch_rows
from benchmarks.rows import Row
from benchmarks.speed import example_rows, speed_rows
from benchmarks.wide import wide_rows
from tests.fixtures.public_cases import CASES

OUT = Path("out/benchmarks/identification.json")
GROUPS: dict[str, Callable[[int], Iterator[Row]]] = {
    "bound": bound_rows,
    "coverage": coverage_rows,
    "ambient": ambient_rows,
    "example": example_rows,
    "patch": patch_rows,
    "drift": drift_rows,
    "speed": speed_rows,
    "wide": wide_rows,
    "battery": battery_rows,
    **{case: partial(case_rows, case) for case in CASES},
}


def main() -> None:
    """Run the groups asked for, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=[*GROUPS, "cases"], default=list(GROUPS))
    parser.add_argument("--seeds", type=int, default=20)
    arguments = parser.parse_args()
    wanted = [name for group in arguments.only for name in (CASES if group == "cases" else [group])]
    for group in wanted:
        rows = []
        for row in GROUPS[group](arguments.seeds):
            print(row.line(), flush=True)
            rows.append(row.as_json())
        _write(rows)


def _write(rows: list[dict[str, float | str]]) -> None:
    """Into the file, in the place of earlier rows of the same name."""
    kept = json.loads(OUT.read_text()) if OUT.exists() else []
    measured = {row["what"]: row for row in [*kept, *rows]}
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps(list(measured.values()), indent=1))


if __name__ == "__main__":
    main()
