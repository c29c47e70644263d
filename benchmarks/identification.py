"""How good the identification is, in numbers: `python -m benchmarks.identification [--only GROUP …] [--seeds N]`.

Prints a table and writes out/benchmarks/identification.json: rows of what, value, unit, floor (what it must at least
reach) and aim. Groups run one by one; a group that lacks something it needs says so and is left out.
"""

import argparse
import json
from pathlib import Path

from benchmarks.cases import case_rows
from benchmarks.limits import ambient_rows, bound_rows, coverage_rows, drift_rows, patch_rows
from benchmarks.rows import Row
from benchmarks.speed import example_rows, speed_rows

OUT = Path("out/benchmarks/identification.json")
GROUPS = {
    "bound": bound_rows,
    "ambient": ambient_rows,
    "speed": speed_rows,
    "example": example_rows,
    "patch": patch_rows,
    "drift": drift_rows,
    "coverage": coverage_rows,
    "cases": case_rows,
}


def main() -> None:
    """Run the groups asked for, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(GROUPS), default=list(GROUPS))
    parser.add_argument("--seeds", type=int, default=20)
    arguments = parser.parse_args()
    rows: list[Row] = []
    for group in arguments.only:
        for row in GROUPS[group](arguments.seeds):
            print(row.line(), flush=True)
            rows.append(row)
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps([row.as_json() for row in rows], indent=1))


if __name__ == "__main__":
    main()
