"""What every table is made of: the base, how constraints are called, and the types of columns that recur."""

from typing import Any

from sqlalchemy import JSON, BigInteger, Double, Integer, MetaData, String, Table
from sqlalchemy.orm import DeclarativeBase

NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}
"""Every constraint has a name, so that Alembic can drop it again on SQLite."""

Id = String(36)
Word = String(32)
Digest = String(64)
Counter = BigInteger().with_variant(Integer, "sqlite")


class Base(DeclarativeBase):
    """Every table's base; JSON columns hold plain JSON."""

    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map = {dict[str, Any]: JSON(none_as_null=True), float: Double}  # noqa: RUF012


def table_of(entity: type[Base]) -> Table:
    """The table itself, for inserts of many rows that need no objects."""
    table = entity.__table__
    assert isinstance(table, Table)
    return table
