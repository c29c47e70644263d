"""The command line in this process, in a folder of its own, with specifications to give to it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from services.cli.main import app

Call = Callable[..., Result]

SPEC = """\
name: small
source:
  kind: simulation
  frames: 3
  frame_rate_hz: 30
  motion:
    - {organ: trunk, shape: bending_1, frequency_hz: 1, amplitude_m: 0.03}
"""


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Run a command; its output and exit code."""
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SPEC)
    return path


def stored(path: Path) -> Any:
    """A JSON file."""
    return json.loads(path.read_text())
