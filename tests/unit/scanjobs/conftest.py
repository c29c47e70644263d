"""A migrated SQLite database in a folder of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs.migrate import upgrade
from scanjobs.store import Store, open_store

MOTION = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.0, "amplitude_m": 0.01}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """An empty database."""
    url = f"sqlite:///{tmp_path / 'test.db'}"
    upgrade(url)
    opened = open_store(url)
    yield opened
    opened.close()


@pytest.fixture
def spec() -> ScanSpec:
    """A simulation of three frames."""
    source = {"kind": "simulation", "frames": 3, "frame_rate_hz": 30.0, "motion": [MOTION]}
    return ScanSpec.model_validate({"source": source, "tags": ["wind", "dry"], "plant": {"id": "acai-7"}})
