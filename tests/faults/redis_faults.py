"""What the faults of Redis share: the API beside the worker, and how long its requests take."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import httpx
from scanjobs.settings import Settings
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.faults.steps import seconds_since
from tests.integration.toy_service import toy_spec


@contextmanager
def api(settings: Settings) -> Iterator[TestClient]:
    """The API on the same database."""
    with TestClient(create_app(settings.model_copy(update={"keyless": True}))) as client:
        yield client


def timed(request: Callable[[], httpx.Response]) -> float:
    """Seconds that a request takes; it is answered with 2xx."""
    began = time.monotonic()
    answer = request()
    assert answer.is_success, answer.text
    return seconds_since(began)


def body(seed: int) -> dict[str, object]:
    """A scan of one frame, as it is posted."""
    return toy_spec(frames=1, seed=seed).model_dump(mode="json")
