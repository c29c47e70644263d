"""`compare`: the modes of two results, or of a result and a truth, side by side."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from nerfmodal.errors import InvalidInput
from rich.table import Table

from services.cli.output import Json, number, percent, print_json, results, table_of

if TYPE_CHECKING:
    from nerfmodal.identify.comparison import ComparisonRow

COLUMNS = ("organ", ">mode", ">truth Hz", ">found Hz", ">damping truth", ">damping found", ">MAC", "verdict")
Row = dict[str, Any]


def compare(
    a: Annotated[Path, typer.Argument(help="A result: its folder, or its result.npz.", show_default=False)],
    b: Annotated[
        Path,
        typer.Argument(help="Another result, or a truth: a capture's folder or its truth.npz.", show_default=False),
    ],
    as_json: Json = False,
) -> None:
    """Pair the modes of two results (or a result and a truth): frequency, damping, MAC."""
    rows = as_rows(rows_of(result_file(a), result_file(b)))
    if as_json:
        print_json(rows)
    else:
        results().print(comparison_table(rows))


def comparison_table(rows: Sequence[Row]) -> Table:
    """organ · mode · truth Hz · found Hz · damping truth, found · MAC · verdict."""
    return table_of(COLUMNS, [_cells(row) for row in rows])


def as_rows(rows: Sequence["ComparisonRow"]) -> list[Row]:
    """The rows of `comparison.json`: unmatched modes of either side have nulls."""
    return [asdict(row) | {"verdict": row.verdict.value if row.verdict else None} for row in rows]


def result_file(path: Path) -> Path:
    """The .npz that a path means: itself, or a folder's result, or its truth. Raises `InvalidInput`."""
    candidates = [path / "result.npz", path / "truth.npz"] if path.is_dir() else [path]
    file = next((candidate for candidate in candidates if candidate.is_file()), candidates[0])
    if not file.is_file():
        hint = "Give the folder of a result, its result.npz, or a truth.npz."
        raise InvalidInput("is not there.", where=str(file), hint=hint)
    return file


def rows_of(a: Path, b: Path) -> list["ComparisonRow"]:
    """A result beside a truth or beside another result. Raises `InvalidInput`."""
    from nerfmodal import io
    from nerfmodal.identify import comparison

    first = io.read_result(a)
    if is_truth(b):
        return comparison.compare(first, io.read_truth(b))
    return comparison.compare_results(first, io.read_result(b))


def is_truth(path: Path) -> bool:
    """Whether an .npz holds imposed modes and no result. Raises `InvalidInput` when it is no .npz."""
    import numpy as np

    try:
        with np.load(path, allow_pickle=False) as archive:
            return "names" in archive.files and "tree" not in archive.files
    except (OSError, ValueError, AttributeError) as error:
        raise InvalidInput(f"is no .npz ({error}).", where=str(path), hint="Give a result.npz or truth.npz.") from error


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row["organ"],
        str(row["mode"]),
        number(row["truth_hz"], 3),
        number(row["found_hz"], 3),
        percent(row["truth_damping"]),
        percent(row["found_damping"]),
        number(row["mac"], 3),
        row["verdict"] or "not found",
    )
