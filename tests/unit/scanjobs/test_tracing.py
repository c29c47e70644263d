"""A request and what is stored in it are one trace; without the extra nothing is made and nothing is asked for."""

import builtins
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from nerfmodal.errors import MissingExtra
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from scanjobs import dispatch, leases, workers
from scanjobs.fanin import plant_next_chunk
from scanjobs.messages import QUEUES
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.tracing import NO_TRACING, Tracing, open_tracing, present
from scanjobs.workers import WorkerIdentity
from starlette.testclient import TestClient

from services.api.app import create_app
from services.api.routes.metrics import Ear
from tests.unit.api.service import simulation

PARENT = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"


@pytest.fixture
def spans() -> InMemorySpanExporter:
    return InMemorySpanExporter()


@pytest.fixture
def tracing(spans: InMemorySpanExporter) -> Iterator[Tracing]:
    provider = TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(spans))
    made = Tracing(provider)
    yield made
    made.close()


def test_span_goes_on_with_its_parent_and_is_passed_on(tracing: Tracing, spans: InMemorySpanExporter) -> None:
    assert present() is None
    with tracing.span("frame.train", PARENT, {"frame": 3}):
        inside = present()
    assert present() is None
    [span] = spans.get_finished_spans()
    assert span.parent is not None
    assert f"{span.parent.span_id:016x}" == PARENT.split("-")[2]
    assert inside is not None
    assert inside.split("-")[1:3] == [PARENT.split("-")[1], f"{span.context.span_id:016x}"]
    assert span.attributes == {"frame": 3}


def test_request_and_its_steps_are_one_trace(
    store: Store, tracing: Tracing, spans: InMemorySpanExporter, tmp_path: Path
) -> None:
    """POST with a caller's trace → the scan's row → its steps → a worker's claim."""
    app = create_app(Settings(data_folder=tmp_path, keyless=True), store)
    with TestClient(Ear(app, app.state.telemetry, tracing)) as http:
        answer = http.post("/v1/scans", json=simulation(), headers={"traceparent": PARENT})
    assert answer.status_code == 202, answer.text
    store.write(lambda session: plant_next_chunk(session, answer.json()["id"]))
    store.write(
        lambda session: workers.register(
            session, WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=1), 60.0
        )
    )
    [message, *_] = store.write(dispatch.dispatch)
    claim = store.write(lambda session: leases.claim(session, message.step_id, "w", 60.0))
    assert claim is not None
    [request] = spans.get_finished_spans()
    assert claim.traceparent is not None
    assert claim.traceparent.split("-")[1:3] == [PARENT.split("-")[1], f"{request.context.span_id:016x}"]


def test_nothing_is_traced_unless_asked_for() -> None:
    tracing = open_tracing(Settings(), "x")
    with tracing.span("a", PARENT, {}), NO_TRACING.span("b", None, {}):
        assert present() is None
    tracing.close()


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any) -> Any:
        if name.startswith("opentelemetry.exporter"):
            raise ImportError(name)
        return real(name, *args)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra) as refusal:
        open_tracing(Settings(otlp_url="http://localhost:4318/v1/traces"), "x")
    assert "nerfmodal[telemetry]" in (refusal.value.hint or "")
