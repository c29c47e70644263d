"""What the service costs, as ratios in one run: `python -m benchmarks.service [--only GROUP …]`.

PostgreSQL (with fsync) and Redis are started for the run, as tests/stack does. Prints a table and writes
out/benchmarks/service.json. Lost and doubled steps are counted by `python -m benchmarks.chaos`.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.rows import Row, print_and_write
from benchmarks.service_listing import listing_rows
from benchmarks.service_posting import posting_rows
from benchmarks.service_servers import Servers, servers
from benchmarks.service_steps import step_rows
from benchmarks.service_workers import worker_rows

OUT = Path("out/benchmarks/service.json")
GROUPS: dict[str, Callable[[Servers], Iterator[Row]]] = {
    "posting": posting_rows,
    "listing": listing_rows,
    "steps": step_rows,
    "workers": worker_rows,
}


def main() -> None:
    """Run the groups asked for, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(GROUPS), default=list(GROUPS))
    groups = parser.parse_args().only
    with servers() as machine:
        print_and_write((row for group in groups for row in GROUPS[group](machine)), OUT)


if __name__ == "__main__":
    main()
