"""What a supervisor and its runner say to each other: one JSON object a line.

To the runner: `{"run": {...}}` and `{"stop": true}`; its stdin closing means "end at once".
From the runner: `{"progress": {...}}` and `{"saved": PATH}`, then `{"produced": {...}}` or `{"failed": {...}}`.
"""

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

Line = dict[str, Any]

TASKS_VARIABLE: Final = "NERFMODAL_TASKS"
"""Environment variable of the module whose TASKS the runner offers."""
DISK_FULL: Final = "DISK_FULL"
"""The code of a failure that is nobody's attempt."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """One step to compute: the specification, the files its parents made, and the folder to write into."""

    kind: str
    frame: int
    spec: dict[str, Any]
    inputs: tuple[dict[str, Any], ...]
    out: str
    save_every_s: float = 30.0
    resume: str | None = None
    """What an earlier attempt has saved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """Why the step could not be computed."""

    code: str
    message: str
    hint: str | None = None
    retryable: bool = True


@dataclass(frozen=True, slots=True)
class Made:
    """A file written by a step: its role among the step's files, and where it is."""

    role: str
    path: Path


def run_line(order: Order) -> Line:
    """The line that starts a step."""
    return {"run": {one.name: getattr(order, one.name) for one in fields(order)}}


def failed_line(failed: Failed) -> Line:
    """The line that ends a step without a result."""
    return {"failed": asdict(failed)}


def saved_line(path: Path) -> Line:
    """The line that hands over what the next attempt would go on from."""
    return {"saved": str(path)}


def produced_line(made: tuple[Made, ...], facts: dict[str, Any]) -> Line:
    """The line that ends a step with its files."""
    return {"produced": {"files": [{"role": one.role, "path": str(one.path)} for one in made], "facts": facts}}


def read_produced(line: Line) -> tuple[tuple[Made, ...], dict[str, Any]]:
    """The files and facts of a `produced` line."""
    produced = line["produced"]
    return tuple(Made(one["role"], Path(one["path"])) for one in produced["files"]), produced["facts"]


def read_failed(line: Line) -> Failed:
    """The reason of a `failed` line."""
    return Failed(**line["failed"])


def encode(line: Line) -> bytes:
    """One line of the wire."""
    return json.dumps(line, separators=(",", ":")).encode() + b"\n"
