"""What a worker tells probes: that it ticks, and whether what steps need is there."""

import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.artifacts import ArtifactStore
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from scanjobs.telemetry import Telemetry

from services.worker.endpoint import Endpoint


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    made = Settings(data_folder=tmp_path, lease_s=4.0)
    upgrade(made.database)
    ArtifactStore(made.artifacts)
    return made


@pytest.fixture
def store(settings: Settings) -> Iterator[Store]:
    opened = open_store(settings.database)
    yield opened
    opened.close()


def endpoint(settings: Settings, store: Store, silent_s: float = 0.0) -> Endpoint:
    return Endpoint(
        settings=settings, store=store, telemetry=Telemetry(settings, store), seconds_since_tick=lambda: silent_s
    )


@pytest.mark.parametrize(("silent_s", "status"), [(0.0, 200), (3.9, 200), (4.1, 503)])
def test_worker_is_alive_while_it_ticks(settings: Settings, store: Store, silent_s: float, status: int) -> None:
    one = endpoint(settings, store, silent_s)
    assert one.answer("/healthz", "")[0] == status
    one.close()


def test_worker_without_a_broker_is_alive_and_not_ready(settings: Settings, store: Store) -> None:
    one = endpoint(settings.model_copy(update={"broker_url": "redis://127.0.0.1:1/0"}), store)
    assert one.answer("/healthz", "")[0] == 200
    status, _, body = one.answer("/readyz", "")
    assert (status, json.loads(body)["checks"]["broker"] != "ok") == (503, True)
    one.close()


def test_it_answers_over_http(settings: Settings, store: Store) -> None:
    one = endpoint(settings, store)
    one.start()
    try:
        for path, expected in (("/readyz", b'"status": "ok"'), ("/metrics", b"nerfmodal_workers 0.0")):
            with urllib.request.urlopen(f"http://127.0.0.1:{one.port}{path}", timeout=5) as answer:
                assert expected in answer.read()
    finally:
        one.stop()
