"""The tables say the same as modes.json, with nothing for what is not known."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
from nerfmodal.export import modes_document, write_csv, write_parquet
from nerfmodal.export.tables import TABLE_COLUMNS

from tests.fixtures.scans import small_result, small_spec

RESULT, SPEC = small_result(), small_spec()
DOCUMENT = modes_document(RESULT, SPEC)
MODES = [mode for organ in DOCUMENT["organs"] for mode in organ["modes"]]


def test_csv_and_document_agree(tmp_path: Path):
    with write_csv(DOCUMENT, tmp_path / "modes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["damping_ratio"]) for row in rows] == [mode["damping_ratio"] for mode in MODES]
    for name in ("reasons", "agreeing_methods"):
        assert [row[name].split() for row in rows] == [mode[name] for mode in MODES]
    assert set(MODES[0]) | {"organ"} == set(TABLE_COLUMNS)


def test_parquet_and_document_agree_in_every_column(tmp_path: Path):
    rows = parquet.read_table(write_parquet(DOCUMENT, tmp_path / "modes.parquet")).to_pylist()
    organs = [organ["name"] for organ in DOCUMENT["organs"] for _ in organ["modes"]]
    assert rows == [{"organ": organ} | mode for organ, mode in zip(organs, MODES, strict=True)]


def test_parquet_carries_the_scan_and_where_it_comes_from(tmp_path: Path):
    metadata = parquet.read_schema(write_parquet(DOCUMENT, tmp_path / "modes.parquet")).metadata
    assert metadata[b"name"] == b"small"
    assert json.loads(metadata[b"provenance"]) == DOCUMENT["provenance"]


def test_unknown_is_null_and_a_scan_without_modes_is_an_empty_table(tmp_path: Path):
    leaf = RESULT.organs[0]
    unknown = replace(leaf, model=replace(leaf.model, frequency_stds=np.full(3, np.nan)))
    table = parquet.read_table(
        write_parquet(modes_document(replace(RESULT, organs=(unknown,)), SPEC), tmp_path / "a.parquet")
    )
    assert table["natural_frequency_hz_std"].to_pylist() == [None] * 3
    empty = parquet.read_table(write_parquet(modes_document(replace(RESULT, organs=()), SPEC), tmp_path / "b.parquet"))
    assert (empty.num_rows, empty.column_names) == (0, list(TABLE_COLUMNS))
