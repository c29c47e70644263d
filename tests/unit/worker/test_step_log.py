"""What a runner writes reaches the database line by line, each once, an unfinished one not before its end."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from scanjobs.leases import Claim
from sqlalchemy.exc import OperationalError

from services.worker import step_log
from services.worker.step_log import MOST_LINES, StepLog


class FakeStore:
    """Runs the work, or is away."""

    def __init__(self) -> None:
        self.away = False

    def write(self, work: Any) -> None:
        if self.away:
            raise OperationalError("INSERT", {}, Exception("away"))
        work(None)


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The lines that were written."""
    lines: list[str] = []

    def append(_: object, *, lines: Sequence[str], **__: object) -> None:
        told_lines.extend(lines)

    told_lines = lines
    monkeypatch.setattr(step_log, "append_lines", append)
    return lines


def log_at(path: Path) -> tuple[StepLog, FakeStore]:
    claim = Claim(step_id="s", scan_id="c", token=1, attempt=1, kind="frame.train", frame=0, spec={}, inputs=())
    store = FakeStore()
    return StepLog(store, claim, path), store  # type: ignore[arg-type]


def write(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text)


def test_lines_come_once_and_whole(tmp_path: Path, told: list[str]) -> None:
    path = tmp_path / "log"
    write(path, "of the step before\n")
    log, _ = log_at(path)
    write(path, "one\ntwo\nthr")
    log.relay()
    assert told == ["one", "two"]
    write(path, "ee\n\n")
    log.relay()
    write(path, "four")
    log.relay(is_over=True)
    assert told == ["one", "two", "three", "four"]


def test_lines_wait_for_a_database_that_is_away(tmp_path: Path, told: list[str]) -> None:
    path = tmp_path / "log"
    log, store = log_at(path)
    write(path, "one\n")
    store.away = True
    log.relay()
    store.away = False
    log.relay()
    assert told == ["one"]


def test_a_flood_is_cut(tmp_path: Path, told: list[str]) -> None:
    path = tmp_path / "log"
    log, _ = log_at(path)
    for _ in range(5):
        write(path, "x\n" * MOST_LINES)
        log.relay()
    assert len(told) == MOST_LINES
