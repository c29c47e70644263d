"""One measured number beside what it must reach."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Row:
    """`floor` is what must at least be reached, `aim` what is wanted."""

    what: str
    value: float
    unit: str
    floor: float
    aim: float

    @property
    def reached(self) -> str:
        """'aim', 'floor' or 'MISSED'; a floor above its aim means that less is better."""
        sign = -1.0 if self.floor > self.aim else 1.0
        if sign * (self.value - self.aim) >= 0:
            return "aim"
        return "floor" if sign * (self.value - self.floor) >= 0 else "MISSED"

    def as_json(self) -> dict[str, float | str]:
        """The row as it is written."""
        return asdict(self)

    def line(self) -> str:
        """The row as it is printed."""
        limits = f"floor {self.floor:<8g} aim {self.aim:<8g} {self.reached}"
        return f"{self.what:68s} {self.value:11.5g} {self.unit:6s} {limits}"


def print_and_write(rows: Iterable[Row], out: Path) -> None:
    """Print each row as soon as it is measured, then write all of them to `out`."""
    measured = []
    for row in rows:
        print(row.line(), flush=True)
        measured.append(row.as_json())
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(measured, indent=1))
