"""How good the identification is, in numbers: `python -m benchmarks.identification [--only GROUP …] [--seeds N]`.

Prints a table and writes out/benchmarks/identification.json: rows of what, value, unit, floor (what it must at least
reach) and aim. Groups run one by one; a group that lacks something it needs says so and is left out.
"""

import argparse
import json
from pathlib import Path

from benchmarks.cases import case_rows
from benchmarks.rows import Row

OUT = Path("out/benchmarks/identification.json")
GROUPS = {"cases": case_rows}


def main() -> None:
    """Run the groups asked for, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=sorted(GROUPS), default=sorted(GROUPS))
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
