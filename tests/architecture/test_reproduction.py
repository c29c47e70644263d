"""docs/reproduction.md says what docs/reproduction.json holds, and the stored result is one of this command."""

import json
from pathlib import Path

import pytest
from nerfmodal.reproduction import page

DOCS = Path(__file__).parents[2] / "docs"
STORED = DOCS / "reproduction.json"

pytestmark = pytest.mark.skipif(not STORED.exists(), reason="no reproduction has been stored yet")


def test_every_number_of_the_page_comes_from_the_stored_result():
    assert (DOCS / "reproduction.md").read_text() == page(json.loads(STORED.read_text())), "type: docs/reproduce.py"


def test_the_stored_result_is_whole():
    stored = json.loads(STORED.read_text())
    assert {"paper", "paper-off-bin"} <= {one["name"] for one in stored["experiments"]}
    assert stored["command"].startswith("nerfmodal reproduce paper --scale")
    assert all(len(one["modes"]) >= 16 and len(one["organs"]) == 6 for one in stored["experiments"])
    assert stored["seconds"] == pytest.approx(sum(one["seconds"] for one in stored["experiments"]), abs=0.2)
