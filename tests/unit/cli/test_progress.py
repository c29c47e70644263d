"""What a person sees of progress: bars on a terminal, lines or nothing elsewhere."""

from dataclasses import dataclass

import pytest

from services.cli import progress
from services.cli.progress import duration, scan_bars, stage_bars


@dataclass(frozen=True)
class Steps:
    step: str
    done: int
    total: int
    fraction: float


@dataclass(frozen=True)
class Stage:
    done: int
    total: int
    message: str = ""


HALF, WHOLE = (Steps("frame.train", 2, 4, 0.6),), (Steps("frame.train", 4, 4, 1.0),)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.4, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (754, "12 min 34 s"), (7260, "2 h 01 min")],
)
def test_durations(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_without_a_terminal_a_line_is_written_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 0.0, 3.0, 11.0, 12.0, 13.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    with scan_bars(lines=True) as show:
        show((Steps("frame.train", 1, 4, 0.3),), None)
        show(HALF, 20)  # 3 s: too soon
        show(HALF, 20)  # 11 s
        show(HALF, 20)  # nothing new
        show(WHOLE, 0)  # the end is always said
    lines = capsys.readouterr().err.splitlines()
    assert [line.split() for line in lines] == [
        ["0", "s", "frame.train", "1/4"],
        ["11", "s", "frame.train", "2/4", "about", "20", "s", "left"],
        ["13", "s", "frame.train", "4/4"],
    ]


@pytest.mark.parametrize("options", [{}, {"quiet": True}, {"quiet": True, "lines": True}])
def test_otherwise_nothing_is_written(capsys: pytest.CaptureFixture[str], options: dict[str, bool]) -> None:
    with scan_bars(**options) as show:
        show(HALF, 20)
    with stage_bars() as report:
        report("train", Stage(1, 2))
    assert capsys.readouterr() == ("", "")


def test_on_a_terminal_there_are_bars(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with scan_bars() as show:
        show(HALF, 20)
    with stage_bars() as report:
        report("train first", Stage(1, 2, "PSNR 27.1"))
    said = capsys.readouterr().err
    for words in ("frame.train", "2/4", "scan: 20 s left", "train first", "1/2", "PSNR 27.1"):
        assert words in said
