"""The database's clock and counter as SQL expressions: seconds since 1970 UTC, so that no two machines' clocks are
compared, and the number of the transaction under way, so that events can be put in the order of their commits.
"""

from typing import Any

from sqlalchemy import BigInteger, Double
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import GenericFunction


class now_s(GenericFunction[float]):
    """`now_s()` in a statement is the present by the database's clock."""

    type = Double()
    name = "now_s"
    inherit_cache = True


@compiles(now_s, "sqlite")
def _on_sqlite(element: now_s, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(now_s, "postgresql")
def _on_postgresql(element: now_s, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "extract(epoch from clock_timestamp())::double precision"


class transaction_number(GenericFunction[int]):
    """`transaction_number()` in a statement is that of its transaction; 0 on SQLite, which has one at a time."""

    type = BigInteger()
    name = "transaction_number"
    inherit_cache = True


@compiles(transaction_number, "sqlite")
def _number_on_sqlite(element: transaction_number, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "0"


@compiles(transaction_number, "postgresql")
def _number_on_postgresql(element: transaction_number, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "pg_current_xact_id()::text::bigint"
