"""`compare`: the modes of two results, or of a result and a truth, side by side."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zipfile import BadZipFile

import typer
from nerfmodal.errors import InvalidInput
from rich.table import Table

from services.cli.output import Json, number, percent, print_json, results, table_of

if TYPE_CHECKING:
    from nerfmodal.identify.comparison import ComparisonRow

TRUTH = ("organ", ">mode", ">truth Hz", ">found Hz", ">damping truth", ">damping found", ">MAC", "verdict")
RESULTS = ("organ", ">mode", ">A Hz", ">B Hz", ">deviations", ">damping A", ">damping B", ">MAC", "verdict of B")
HINT = "Give the folder of a result, its result.npz, or a truth.npz."
Row = dict[str, Any]


def compare(
    a: Annotated[
        Path,
        typer.Argument(help="A result: its folder, or its result.npz; or a truth.", show_default=False),
    ],
    b: Annotated[
        Path,
        typer.Argument(help="Another result, or a truth: a capture's folder or its truth.npz.", show_default=False),
    ],
    as_json: Json = False,
) -> None:
    """Pair the modes of two results (or a result and a truth): frequency, damping, MAC."""
    first, second = result_file(a), result_file(b)
    rows = as_rows(rows_of(first, second))
    if as_json:
        print_json(rows)
    elif "truth" in (kind_of(first), kind_of(second)):
        results().print(comparison_table(rows))
    else:
        results().print(table_of(RESULTS, [_cells_of_two(row) for row in rows]))


def comparison_table(rows: Sequence[Row]) -> Table:
    """organ · mode · truth Hz · found Hz · damping truth, found · MAC · verdict."""
    return table_of(TRUTH, [_cells(row) for row in rows])


def as_rows(rows: Sequence["ComparisonRow"]) -> list[Row]:
    """The rows of `comparison.json`: unmatched modes of either side have nulls."""
    return [
        asdict(row)
        | {
            "verdict": row.verdict.value if row.verdict else None,
            "frequency_error": row.frequency_error,
            "damping_error_points": row.damping_error,
            "frequency_deviations": row.frequency_deviations,
            "damping_deviations": row.damping_deviations,
        }
        for row in rows
    ]


def result_file(path: Path) -> Path:
    """The .npz that a path means: itself, or a folder's result, or its truth. Raises `InvalidInput`."""
    candidates = [path / "result.npz", path / "truth.npz"] if path.is_dir() else [path]
    file = next((candidate for candidate in candidates if candidate.is_file()), candidates[0])
    if not file.is_file():
        raise InvalidInput("is not there.", where=str(file), hint=HINT)
    return file


def rows_of(a: Path, b: Path) -> list["ComparisonRow"]:
    """A result beside a truth, in either order, or beside another result. Raises `InvalidInput`."""
    from nerfmodal import io
    from nerfmodal.identify import comparison

    kinds = kind_of(a), kind_of(b)
    if kinds == ("truth", "truth"):
        raise InvalidInput("is a truth, and so is the other: neither was found.", where=str(b), hint=HINT)
    if "truth" in kinds:
        result, truth = (b, a) if kinds[0] == "truth" else (a, b)
        return comparison.compare(io.read_result(result), io.read_truth(truth))
    return comparison.compare_results(io.read_result(a), io.read_result(b))


def kind_of(path: Path) -> Literal["result", "truth"]:
    """Whether an .npz holds a result or imposed modes. Raises `InvalidInput` when it is neither."""
    import numpy as np

    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            names = set(archive.files)
    except (OSError, EOFError, ValueError, TypeError, AttributeError, BadZipFile) as error:
        raise InvalidInput(f"is no .npz ({error}).", where=str(path), hint=HINT) from error
    if "tree" in names:
        return "result"
    if "names" in names:
        return "truth"
    raise InvalidInput("is neither a result nor a truth.", where=str(path), hint=HINT)


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


def _cells_of_two(row: Row) -> tuple[str, ...]:
    cells = _cells(row)
    return (*cells[:4], number(row["frequency_deviations"], 1), *cells[4:])
