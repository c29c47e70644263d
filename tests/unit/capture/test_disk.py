"""A disk that is full while clouds are written: the command says so, and what was finished stays whole."""

import errno
from pathlib import Path

import pytest
from nerfmodal.io import atomic_write

from services.cli.outcomes import FAILED, ending_of


def test_a_full_disk_ends_a_command_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "frame_0000.ply"))

    (tmp_path / "frame_0000.ply").write_text("before")
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space") as caught, atomic_write(tmp_path / "frame_0000.ply") as temporary:
        temporary.write_text("half")
    assert [one.name for one in tmp_path.iterdir()] == ["frame_0000.ply"]
    assert (tmp_path / "frame_0000.ply").read_text() == "before"
    ending = ending_of(caught.value)
    assert ending is not None
    assert (ending.exit_code, ending.code) == (FAILED, "DISK_FULL")
    assert "frame_0000.ply" in ending.complaints[0].pointer
    assert "--out" in ending.complaints[0].hint


def test_other_errors_of_the_system_are_not_hidden() -> None:
    assert ending_of(OSError(errno.EIO, "Input/output error")) is None
