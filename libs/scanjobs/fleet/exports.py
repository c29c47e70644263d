"""Files of a fleet: the long table as CSV or Parquet, and a study as an RO-Crate (1.1) in a zip archive."""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final

from sqlalchemy import select
from sqlalchemy.orm import Session

from scanjobs.fleet.environment import values_of
from scanjobs.fleet.long_rows import long_rows
from scanjobs.fleet.long_table import COLUMNS, NUMBERS, TRAITS, Extent, plants_of
from scanjobs.fleet.tables import Alarm, Environment, Plant, PlantEvent
from scanjobs.store import Store

CHUNK: Final = 2000
CRATE: Final = "https://w3id.org/ro/crate/1.1"
EPOCH: Final = (1980, 1, 1, 0, 0, 0)
PLANT_COLUMNS: Final = (
    *("id", "name", "study", "treatment", "species", "genotype", "replicate", "block", "position", "tags"),
    *("notes", "scans", "ratio"),
)
Row = Mapping[str, Any]


def csv_of(rows: Iterable[Row], columns: Iterable[str]) -> Iterator[bytes]:
    """A table as CSV (RFC 4180, UTF-8), in chunks; nothing stands for what is not known."""
    names = tuple(columns)
    return _written(([_plain(row.get(name)) for name in names] for row in rows), names)


def _written(rows: Iterable[Sequence[Any]], columns: Sequence[str]) -> Iterator[bytes]:
    rows, buffer = iter(rows), io.StringIO(newline="")
    writer = csv.writer(buffer)
    writer.writerow(columns)
    while True:
        chunk = list(islice(rows, CHUNK))
        writer.writerows(chunk)
        yield buffer.getvalue().encode()
        buffer.seek(0)
        buffer.truncate()
        if len(chunk) < CHUNK:
            return


def observations_csv(store: Store, extent: Extent) -> Iterator[bytes]:
    """The long table of an extent, in chunks."""
    return _written(long_rows(store, extent, _plain), COLUMNS)


def write_parquet(store: Store, extent: Extent, path: Path) -> None:
    """The long table as Parquet: words as text, numbers as doubles, `at` as a moment in UTC."""
    import pyarrow as pa  # here: who exports nothing need not wait for it
    import pyarrow.parquet as pq

    kinds = {name: pa.float64() for name in NUMBERS} | {"at": pa.timestamp("ms", tz="UTC")}
    schema = pa.schema([(name, kinds.get(name, pa.string())) for name in COLUMNS])
    rows, at = long_rows(store, extent), COLUMNS.index("at")
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        while chunk := list(islice(rows, 10 * CHUNK)):
            columns = list(zip(*chunk, strict=True))
            columns[at] = tuple(map(datetime.fromisoformat, columns[at]))
            writer.write_table(pa.table(columns, schema=schema))


def write_crate(store: Store, extent: Extent, path: Path) -> None:
    """A study as an RO-Crate: tables as CSV, each described in ro-crate-metadata.json."""
    tables: tuple[tuple[str, str, Callable[[Session, Extent], Iterator[bytes]]], ...] = (
        ("plants.csv", "The plants with their factors (MIAPPE observation units)", _plants),
        ("environment.csv", "Surroundings by plant, and of the whole house", _environment),
        ("events.csv", "What was done to the plants", _events),
        ("alarms.csv", "What was not as it should be", _alarms),
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        name, what = "observations.csv", "Modes of every scan, one row per plant × scan × track × trait"
        files = [_file_entity(name, what, _write(archive, name, observations_csv(store, extent)))]
        for name, what, chunks in tables:
            with store.read() as session:
                files.append(_file_entity(name, what, _write(archive, name, chunks(session, extent))))
        document = json.dumps(crate_document(extent, files), indent=2, ensure_ascii=False)
        archive.writestr(_member("ro-crate-metadata.json"), document)


def _write(archive: zipfile.ZipFile, name: str, chunks: Iterable[bytes]) -> int:
    """A member of the archive; returns how many bytes it has."""
    with archive.open(_member(name), "w") as file:
        return sum(file.write(chunk) for chunk in chunks)


def _member(name: str) -> zipfile.ZipInfo:
    """A compressed member whose bytes do not depend on when it was written."""
    member = zipfile.ZipInfo(name, EPOCH)
    member.compress_type = zipfile.ZIP_DEFLATED
    return member


def crate_document(extent: Extent, files: list[dict[str, Any]]) -> dict[str, Any]:
    """The crate's JSON-LD: RO-Crate 1.1, section 'Root Data Entity'."""
    study = extent.study or "fleet"
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": f"Modal parameters of the study {study}",
        "description": "Natural frequencies, damping ratios and shapes of plants, identified from point clouds.",
        "identifier": study,
        "datePublished": f"{datetime.now(UTC):%Y-%m-%d}",
        "license": {"@id": "#license"},
        "conformsTo": {"@id": "https://www.miappe.org/"},
        "hasPart": [{"@id": entity["@id"]} for entity in files],
        "variableMeasured": [{"@id": f"#{trait.name}"} for trait in TRAITS],
    }
    traits = [
        {
            "@id": f"#{trait.name}",
            "@type": "PropertyValue",
            "name": trait.name,
            "description": trait.what,
            "unitText": trait.unit,
            "measurementTechnique": trait.method,
        }
        for trait in TRAITS
    ]
    about = {
        "@id": "ro-crate-metadata.json",
        "@type": "CreativeWork",
        "conformsTo": {"@id": CRATE},
        "about": {"@id": "./"},
    }
    terms = {"@id": "#license", "@type": "CreativeWork", "name": "All rights stay with the owner of the study."}
    return {"@context": f"{CRATE}/context", "@graph": [about, root, terms, *files, *traits]}


def _file_entity(name: str, what: str, size: int) -> dict[str, Any]:
    return {
        "@id": name,
        "@type": "File",
        "name": name,
        "description": what,
        "encodingFormat": "text/csv",
        "contentSize": str(size),
    }


def _plants(session: Session, extent: Extent) -> Iterator[bytes]:
    rows = ({name: getattr(plant, name) for name in PLANT_COLUMNS} for plant in plants_of(session, extent))
    return csv_of((row | {"tags": " ".join(row["tags"])} for row in rows), PLANT_COLUMNS)


def _environment(session: Session, extent: Extent) -> Iterator[bytes]:
    names = {plant.key: plant.id for plant in plants_of(session, extent)} | {"": ""}
    query = select(Environment).where(Environment.owner == extent.owner).order_by(Environment.at, Environment.place)
    found = [row for row in session.scalars(query) if row.place in names]
    values = [{"plant": names[row.place], "at": _moment(row.at), **values_of(row)} for row in found]
    columns = sorted({name for row in values for name in row} - {"plant", "at"})
    return csv_of(values, ("plant", "at", *columns))


def _events(session: Session, extent: Extent) -> Iterator[bytes]:
    names = {plant.key: plant.id for plant in plants_of(session, extent)}
    mine = select(PlantEvent).join(Plant, Plant.key == PlantEvent.plant_key).where(Plant.owner == extent.owner)
    found = session.scalars(mine.order_by(PlantEvent.at, PlantEvent.id))
    columns = ("kind", "note", "amount", "unit")
    rows = (
        {"plant": names[row.plant_key], "at": _moment(row.at), **{name: getattr(row, name) for name in columns}}
        for row in found
        if row.plant_key in names
    )
    return csv_of(rows, ("plant", "at", *columns))


def _alarms(session: Session, extent: Extent) -> Iterator[bytes]:
    names = {plant.key: plant.id for plant in plants_of(session, extent)}
    found = session.scalars(select(Alarm).where(Alarm.owner == extent.owner).order_by(Alarm.id))
    told = ("title", "change_percent", "change_percent_std", "confidence", "delay_scans", "delay_s")
    rows = (
        {name: row.evidence.get(name) for name in told}
        | {name: getattr(row, name) for name in ("id", "kind", "severity", "state", "note")}
        | {"plant": names[row.plant_key], "since": _moment(row.evidence["since"]), "opened_at": _moment(row.opened_at)}
        for row in found
        if row.plant_key in names
    )
    return csv_of(rows, ("id", "plant", "kind", "severity", "state", "since", "opened_at", *told, "note"))


def _moment(at: float | None) -> str:
    return "" if at is None else datetime.fromtimestamp(at, UTC).isoformat()


def _plain(value: Any) -> Any:
    """A spreadsheet takes text that begins so for a formula: an apostrophe keeps it text (OWASP, CSV injection)."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "@", "\t", "\r") else value
