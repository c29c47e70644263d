"""Fault 21: the OpenAPI document fuzzed by schemathesis: all its checks, every operation, and chains of them; no 5xx.

The service asks for keys, so that the check of ignored authentication means something. Streams have no end and are
left out (tests/unit/api/test_events.py has them). 412 is what tus asks for. What valid data may be refused with besides
is a rule that JSON Schema cannot say: a cursor that was signed, a path that is there, an address that is public.
The limit of wrong keys from one address is lifted: the fuzzer sends hundreds a minute, and their 429 would stand before
the 401 that it looks for. That limit has its own test (tests/unit/api/test_keys.py).
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.artifacts import ArtifactStore
from scanjobs.migrate import upgrade
from scanjobs.owners import issue_key
from scanjobs.scopes import Scope
from scanjobs.settings import Settings
from scanjobs.store import open_store

from services.api import doorkeeper
from services.api.app import create_app
from tests.unit.api.live import live

CONFIG = """
[checks]
missing_required_header.expected-statuses = ["400", "401", "403", "412", "415", "422"]
negative_data_rejection.expected-statuses = ["400", "401", "403", "404", "405", "409", "412", "415", "422", "429"]
positive_data_acceptance.expected-statuses = ["2xx", "400", "401", "403", "404", "409", "412", "413", "415", "422"]

[[operations]]
include-name = "POST /v1/scans"
# a specification takes numbers in quotes, as a form or YAML may write them; JSON Schema calls them strings
checks.negative_data_rejection.expected-statuses = ["2xx", "4xx"]

[[operations]]
include-name = "POST /v1/uploads"
# headers that nobody knows are no mistake
checks.negative_data_rejection.expected-statuses = ["2xx", "4xx"]
"""


@pytest.fixture
def address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, str]]:
    """Where a service listens, and a key that may do everything."""
    monkeypatch.setattr(doorkeeper, "FAILURES_PER_MINUTE", 10**6)
    settings = Settings(data_folder=tmp_path / "data", capture_roots=(tmp_path,), keyless=False)
    upgrade(settings.database)
    store = open_store(settings.database)
    key = store.write(
        lambda session: issue_key(session, owner="fuzz", name="k", scopes=[Scope.ADMIN], requests_per_minute=10**6)
    )
    with live(create_app(settings, store, ArtifactStore(settings.artifacts))) as listening:
        yield listening, key.secret
    store.close()


def test_the_service_does_what_its_document_says(address: tuple[str, str], tmp_path: Path) -> None:
    where, key = address
    config = tmp_path / "schemathesis.toml"
    config.write_text(CONFIG)
    command = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(config), "run", f"{where}/openapi.json"]
    command += ["--header", f"Authorization: Bearer {key}", "--exclude-path-regex", "events$", "--checks", "all"]
    command += ["--max-examples", "1", "--generation-deterministic", "--suppress-health-check", "all", "--no-color"]
    command += ["--phases", "coverage,stateful", "--continue-on-failure"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2000:]
    generated = re.search(r"(\d+) generated", done.stdout)
    assert generated is not None
    assert int(generated[1]) > 500, "the fuzzer must have reached the operations"
