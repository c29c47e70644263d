"""Standard output is for results, standard error for progress; `--json` turns results into one JSON document."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.table import Table

WIDTH_WITHOUT_TERMINAL = 400
MACHINE = "machine"


def _remember(ctx: typer.Context, value: bool) -> bool:
    if value:
        ctx.find_root().meta[MACHINE] = True
    return value


Json = Annotated[bool, typer.Option("--json", callback=_remember, help="Print one JSON document, for machines.")]


def wants_json(ctx: typer.Context) -> bool:
    """Whether the command was called with `--json`."""
    return bool(ctx.find_root().meta.get(MACHINE))


def results() -> Console:
    """Where results go."""
    return _console(sys.stdout)


def notes() -> Console:
    """Where progress and remarks go."""
    return _console(sys.stderr)


def print_json(document: Any) -> None:
    """One JSON document on standard output."""
    sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False) + "\n")


def table_of(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None) -> Table:
    """A plain table; columns that begin with '>' are right-aligned, and the last one may wrap."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for place, column in enumerate(columns, start=1):
        side: Literal["left", "right"] = "right" if column.startswith(">") else "left"
        table.add_column(column.removeprefix(">"), justify=side, no_wrap=place < len(columns))
    for row in rows:
        table.add_row(*row)
    return table


def modes_table(document: Mapping[str, Any]) -> Table:
    """The modes of a modes.json, each with its standard deviation and verdict."""
    columns = ("organ", ">mode", ">f (Hz)", ">± std", ">damping", ">± std", ">MPC", ">energy", "verdict")
    rows = [_mode_row(organ["name"], k, mode) for organ in document["organs"] for k, mode in enumerate(organ["modes"])]
    return table_of(columns, rows)


def number(value: float | None, digits: int) -> str:
    """A number, or a dash for one that is not known."""
    return "–" if value is None else f"{value:.{digits}f}"


def percent(value: float | None, digits: int = 2) -> str:
    """A share of 1 as per cent."""
    return "–" if value is None else f"{100 * value:.{digits}f} %"


def _mode_row(organ: str, k: int, mode: Mapping[str, Any]) -> tuple[str, ...]:
    reasons = f" ({', '.join(mode['reasons'])})" if mode.get("reasons") else ""
    return (
        organ,
        str(k),
        number(mode["natural_frequency_hz"], 3),
        number(mode.get("natural_frequency_hz_std"), 3),
        percent(mode["damping_ratio"]),
        percent(mode.get("damping_ratio_std")),
        number(mode.get("mpc"), 2),
        percent(mode.get("energy_share"), 1),
        f"{mode['verdict']}{reasons}",
    )


def _console(stream: Any) -> Console:
    width = None if stream.isatty() else WIDTH_WITHOUT_TERMINAL
    return Console(file=stream, width=width, highlight=False, soft_wrap=not stream.isatty())
