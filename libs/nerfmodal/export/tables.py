"""Modes as tables, a mode a line: `modes.csv` for people, `modes.parquet` for programs.

Both have the columns of `TABLE_COLUMNS` with their units in the names; what is not known is empty (CSV) or null
(Parquet). Lists are words between spaces in CSV; Parquet's metadata holds the scan's name and its provenance.
"""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as parquet

from nerfmodal.io import atomic_write

WORDS, WHOLE, NUMBER = pa.string(), pa.int64(), pa.float64()
TABLE_COLUMNS = {
    "organ": WORDS,
    "mode": WHOLE,
    "natural_frequency_hz": NUMBER,
    "natural_frequency_hz_std": NUMBER,
    "damped_frequency_hz": NUMBER,
    "damped_frequency_hz_std": NUMBER,
    "damping_ratio": NUMBER,
    "damping_ratio_std": NUMBER,
    "amplitude_m": NUMBER,
    "energy_share": NUMBER,
    "mpc": NUMBER,
    "mac_between_methods": NUMBER,
    "agreeing_methods": pa.list_(WORDS),
    "verdict": WORDS,
    "reasons": pa.list_(WORDS),
    "normalisation": WORDS,
    "shape": WORDS,
}
"""The columns and their types in Parquet."""
LISTS = ("agreeing_methods", "reasons")


def mode_rows(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The modes of `modes.json` as rows: organ by organ, in its order."""
    return [
        {name: mode.get(name, organ["name"]) for name in TABLE_COLUMNS}
        for organ in document["organs"]
        for mode in organ["modes"]
    ]


def write_csv(document: Mapping[str, Any], path: Path) -> Path:
    """Write the modes of `modes.json` as a CSV."""
    rows = [row | {name: " ".join(row[name]) for name in LISTS} for row in mode_rows(document)]
    with atomic_write(path) as temporary, temporary.open("w", newline="") as file:
        table = csv.DictWriter(file, fieldnames=list(TABLE_COLUMNS))
        table.writeheader()
        table.writerows(rows)
    return path


def write_parquet(document: Mapping[str, Any], path: Path) -> Path:
    """Write the modes of `modes.json` as a Parquet table."""
    metadata = {"name": document["name"], "provenance": json.dumps(document["provenance"])}
    schema = pa.schema(list(TABLE_COLUMNS.items()), metadata=metadata)
    table = pa.Table.from_pylist(mode_rows(document), schema=schema)
    with atomic_write(path) as temporary:
        parquet.write_table(table, temporary)
    return path
