"""One trace from a request to the steps that come of it, where the extra `telemetry` is installed and asked for.

The trace travels as a W3C `traceparent`: from the request's header, through the
scan's row, into each claim. Without the extra, or without `otlp_url`, everything here does nothing, cheaply.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Final

from nerfmodal.errors import MissingExtra

from scanjobs.settings import Settings

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

Attributes = Mapping[str, str | int | float]
HEADER: Final = "traceparent"
_present: ContextVar[str | None] = ContextVar("traceparent", default=None)


class Tracing:
    """Makes spans and sends them; one per process, made after any fork, because it has a thread."""

    def __init__(self, provider: "TracerProvider | None") -> None:
        self._provider = provider

    @contextmanager
    def span(self, name: str, parent: str | None, attributes: Attributes) -> Iterator[None]:
        """A span around the block; what is stored or sent in it goes on with its trace (`present`)."""
        if self._provider is None:
            yield
            return
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        propagator = TraceContextTextMapPropagator()
        context = propagator.extract({HEADER: parent} if parent else {})
        tracer = self._provider.get_tracer("nerfmodal")
        with tracer.start_as_current_span(name, context=context, attributes=dict(attributes)):
            carrier: dict[str, str] = {}
            propagator.inject(carrier)
            token = _present.set(carrier.get(HEADER))
            try:
                yield
            finally:
                _present.reset(token)

    def close(self) -> None:
        """Send what has not been sent."""
        if self._provider is not None:
            self._provider.shutdown()


NO_TRACING: Final = Tracing(None)


def present() -> str | None:
    """The `traceparent` of the span around the caller."""
    return _present.get()


def open_tracing(settings: Settings, service: str) -> Tracing:
    """Tracing as the settings say; `service` is what the process is called in the traces.

    Raises
    ------
    MissingExtra
        `otlp_url` is set and the extra `telemetry` is not installed.
    """
    if not settings.otlp_url:
        return Tracing(None)
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        raise MissingExtra("opentelemetry-sdk", "telemetry") from error
    provider = TracerProvider(resource=Resource.create({"service.name": service}))
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter(endpoint=settings.otlp_url)))
    return Tracing(provider)
