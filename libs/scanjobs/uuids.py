"""Names that sort by the time they were given at."""

import uuid6


def new_id() -> str:
    """A UUIDv7: later ids sort after earlier ones."""
    return str(uuid6.uuid7())
