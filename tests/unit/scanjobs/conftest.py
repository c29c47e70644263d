"""A migrated SQLite database in a folder of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs.store import Store, open_store

from tests.conftest import copy_database

MOTION = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.0, "amplitude_m": 0.01}


@pytest.fixture
def store(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Store]:
    """An empty database."""
    copy_database(migrated_sqlite, tmp_path)
    opened = open_store(f"sqlite:///{tmp_path / 'nerfmodal.db'}")
    yield opened
    opened.close()


@pytest.fixture
def spec() -> ScanSpec:
    """A simulation of three frames."""
    source = {"kind": "simulation", "frames": 3, "frame_rate_hz": 30.0, "motion": [MOTION]}
    return ScanSpec.model_validate({"source": source, "tags": ["wind", "dry"], "plant": {"id": "acai-7"}})
