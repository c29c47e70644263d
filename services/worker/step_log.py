"""What a runner writes to its standard error while it computes a step, told to the database as it comes.

A log is no result: when the database is away its lines are kept for the next look, and what is too much is left out.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from scanjobs.leases import Claim
from scanjobs.log_lines import append_lines
from scanjobs.store import Store
from sqlalchemy.exc import SQLAlchemyError

MOST_LINES: Final = 2000
MOST_BYTES: Final = 1 << 18
"""Of one attempt, and of one look; the worker's own file has the rest."""


class StepLog:
    """The lines that one attempt adds to its runner's log file."""

    def __init__(self, store: Store, claim: Claim, path: Path) -> None:
        self._store = store
        self._claim = claim
        self._path = path
        self._at = path.stat().st_size if path.exists() else 0
        self._told = 0

    def say(self, text: str, level: str = "info") -> None:
        """A line of the supervisor's own."""
        self._tell([text], level)

    def relay(self, *, is_over: bool = False) -> None:
        """Tell what has come since the last look; an unfinished line only when nothing more will come."""
        text = self._new_text(is_over)
        lines = [line for line in text.decode(errors="replace").splitlines() if line.strip()]
        left = MOST_LINES - self._told
        if not lines or left <= 0 or self._tell(lines[:left], "info"):
            self._at += len(text)
            self._told += len(lines)

    def _new_text(self, is_over: bool) -> bytes:
        try:
            with self._path.open("rb") as file:
                file.seek(self._at)
                text = file.read(MOST_BYTES)
        except OSError:
            return b""
        return text if is_over or len(text) == MOST_BYTES else text[: text.rfind(b"\n") + 1]

    def _tell(self, lines: Sequence[str], level: str) -> bool:
        claim = self._claim
        try:
            self._store.write(
                lambda session: append_lines(
                    session,
                    scan_id=claim.scan_id,
                    step_id=claim.step_id,
                    token=claim.token,
                    level=level,
                    lines=lines,
                )
            )
        except SQLAlchemyError:
            return False
        return True
