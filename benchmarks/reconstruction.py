"""How good and how fast the reconstruction is, in numbers: `python -m benchmarks.reconstruction [--only GROUP …]`.

Films the simulated palm (kept under out/benchmarks/films), reconstructs every frame with one seed, and compares with
the truth. Prints a table and writes out/benchmarks/reconstruction.json. `--frames` shortens the film.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.films import Film, palm
from benchmarks.following import following_rows
from benchmarks.geometry import geometry_rows
from benchmarks.rays import memory_rows, roofline_rows
from benchmarks.rows import Row, print_and_write

OUT = Path("out/benchmarks/reconstruction.json")
GROUPS: dict[str, Callable[[Film], Iterator[Row]]] = {
    "roofline": roofline_rows,
    "geometry": geometry_rows,
    "motion": following_rows,
    "memory": memory_rows,
}


def main() -> None:
    """Run the groups asked for, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(GROUPS), default=list(GROUPS))
    parser.add_argument("--frames", type=int, default=90)
    arguments = parser.parse_args()
    film = Film(spec=palm(0.05, frames=arguments.frames))
    print_and_write((row for group in arguments.only for row in GROUPS[group](film)), OUT)


if __name__ == "__main__":
    main()
