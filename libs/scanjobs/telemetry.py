"""What a process tells Prometheus: the totals and gauges of the database, and what this process alone can know.

One `Telemetry` per process, with a registry of its own. What `meters` reads is the same in every process, so sums over
processes must take `max without (instance)`; what begins with `nerfmodal_process_` or `nerfmodal_http_` is this
process's own.
"""

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector
from sqlalchemy import event
from sqlalchemy.exc import SQLAlchemyError

from scanjobs import meters
from scanjobs.disk import free_bytes
from scanjobs.inputs import program_version
from scanjobs.meters import BEYOND, LAG_EDGES, STEP_EDGES, Total
from scanjobs.settings import Settings
from scanjobs.store import Store

QUICK_EDGES: Final = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0)
STATEMENTS: Final = frozenset({"SELECT", "INSERT", "UPDATE", "DELETE", "BEGIN"})
FRESH_S: Final = 1.0
"""What was read from the database is told again for this long: scrapes in a row cost one look."""
ARTIFACTS_FRESH_S: Final = 60.0

COUNTERS: Final[Mapping[str, tuple[str, Sequence[str]]]] = {
    "attempts": ("Claims of steps that have ended.", ("kind", "outcome")),
    "retries": ("Ended claims that were not the first of their step.", ("kind",)),
    "lease_expiries": ("Steps taken from a worker that was not heard of any more.", ("kind",)),
    "lost_seconds": ("Wall time of claims that came to nothing.", ("kind", "outcome")),
    "artifact_bytes_written": ("Bytes of accepted results.", ("kind",)),
    "rays": ("Rays marched by accepted trainings.", ()),
    "scans_ended": ("Scans that have ended.", ("state",)),
    "webhook_attempts": ("Attempts to deliver a message to a webhook.", ("outcome",)),
}
HISTOGRAMS: Final[Mapping[str, tuple[str, Sequence[str], Sequence[float]]]] = {
    "step_seconds": ("From the claim of a step to its accepted result.", ("kind",), STEP_EDGES),
    "dispatch_lag_seconds": ("From ready to claimed.", ("queue",), LAG_EDGES),
}


class Telemetry:
    """The instruments of one process."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self.registry = CollectorRegistry()
        self.http = Histogram(
            "nerfmodal_http_seconds",
            "From a request to the end of its answer.",
            ["method", "route", "status"],
            buckets=QUICK_EDGES,
            registry=self.registry,
        )
        self._database = Histogram(
            "nerfmodal_process_database_seconds",
            "One statement, from here and back.",
            ["statement"],
            buckets=QUICK_EDGES,
            registry=self.registry,
        )
        self.messages = Counter("nerfmodal_process_messages", "Messages published.", registry=self.registry)
        self.broker_errors = Counter(
            "nerfmodal_process_broker_errors", "Messages that the broker did not take.", registry=self.registry
        )
        self.last_tick = Gauge(
            "nerfmodal_process_last_tick_timestamp_seconds", "When the last tick ended.", registry=self.registry
        )
        self.registry.register(ProcessCollector(registry=None))
        self.registry.register(Truth(settings, store))
        event.listen(store.engine, "before_cursor_execute", _begin)
        event.listen(store.engine, "after_cursor_execute", self._end)

    def exposition(self, accept: str = "") -> tuple[bytes, str]:
        """Everything in the format that the `Accept` header asks for, and its content type."""
        encode, content_type = choose_encoder(accept)
        return encode(self.registry), content_type

    def _end(self, connection: Any, cursor: Any, statement: str, parameters: Any, context: Any, many: bool) -> None:  # noqa: ARG002
        began = getattr(context, "nerfmodal_began", None)
        if began is not None:
            word = statement.lstrip()[:6].upper()
            label = word.lower() if word in STATEMENTS else "other"
            self._database.labels(label).observe(time.perf_counter() - began)


def _begin(connection: Any, cursor: Any, statement: str, parameters: Any, context: Any, many: bool) -> None:  # noqa: ARG001
    if context is not None:
        context.nerfmodal_began = time.perf_counter()


class Truth(Collector):
    """Reads the database when it is scraped; says `nerfmodal_database_up 0` and nothing else when it cannot."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._told: tuple[Metric, ...] = ()
        self._told_at = self._artifacts_at = -ARTIFACTS_FRESH_S
        self._artifacts = (0, 0)

    def describe(self) -> Iterator[Metric]:
        """Nothing: asked for at registration, when the database may be away."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """Every family of the database, and this machine's disk."""
        if time.monotonic() - self._told_at >= FRESH_S:
            self._told = tuple(self._look())
            self._told_at = time.monotonic()
        yield from self._told
        yield GaugeMetricFamily(
            "nerfmodal_disk_free_bytes", "Where data and artifacts lie.", free_bytes(self._settings)
        )
        build = GaugeMetricFamily("nerfmodal_build_info", "The version that runs.", labels=["version"])
        build.add_metric([program_version()], 1.0)
        yield build

    def _look(self) -> Iterator[Metric]:
        try:
            families = list(self._families())
        except SQLAlchemyError:
            families = []
        yield GaugeMetricFamily("nerfmodal_database_up", "Whether the database answers.", float(bool(families)))
        yield from families

    def _families(self) -> Iterator[Metric]:
        with self._store.read() as session:
            totals, gauges = meters.read_totals(session), meters.read_gauges(session)
            if time.monotonic() - self._artifacts_at >= ARTIFACTS_FRESH_S:
                self._artifacts = meters.read_artifacts(session)
                self._artifacts_at = time.monotonic()
        yield from families_of_totals(totals)
        yield from families_of_gauges(gauges)
        number, size = self._artifacts
        yield GaugeMetricFamily("nerfmodal_artifacts", "Files that the database knows.", number)
        yield GaugeMetricFamily("nerfmodal_artifact_bytes", "Bytes of them.", size)


def families_of_totals(totals: Sequence[Total]) -> Iterator[Metric]:
    """Counters and histograms; one that has counted nothing yet is 0 without labels, or has no samples."""
    by_name: dict[str, list[Total]] = defaultdict(list)
    for total in totals:
        by_name[total.name].append(total)
    for name, (words, labels) in COUNTERS.items():
        counter = CounterMetricFamily(f"nerfmodal_{name}", words, labels=labels)
        for total in by_name[name]:
            counter.add_metric([total.labels[label] for label in labels], total.value)
        if not labels and not by_name[name]:
            counter.add_metric([], 0.0)
        yield counter
    for name, (words, labels, edges) in HISTOGRAMS.items():
        histogram = HistogramMetricFamily(f"nerfmodal_{name}", words, labels=labels)
        for total in by_name[f"{name}_sum"]:
            values = [total.labels[label] for label in labels]
            counts = {row.labels["le"]: row.value for row in by_name[f"{name}_bucket"] if _has(row, labels, values)}
            histogram.add_metric(values, cumulate(counts, edges), sum_value=total.value)
        yield histogram


def cumulate(counts: Mapping[str, float], edges: Sequence[float]) -> list[tuple[str, float]]:
    """Prometheus' buckets: how many were at most each edge."""
    buckets, sofar = [], 0.0
    for edge in (*(f"{edge:g}" for edge in edges), BEYOND):
        sofar += counts.get(edge, 0.0)
        buckets.append((edge, sofar))
    return buckets


def families_of_gauges(gauges: meters.Gauges) -> Iterator[Metric]:
    """What waits, runs and is overdue."""
    steps = GaugeMetricFamily("nerfmodal_steps", "Steps that have not ended.", labels=["queue", "state"])
    for (queue, state), number in sorted(gauges.steps.items()):
        steps.add_metric([queue, state], number)
    yield steps
    yield _by_one(
        "nerfmodal_oldest_ready_seconds", "Wait of the oldest step to be claimed.", "queue", gauges.oldest_ready_s
    )
    yield _by_one("nerfmodal_slots", "Slots of living workers that serve the queue.", "queue", gauges.slots)
    yield _by_one("nerfmodal_scans", "Scans that have not ended.", "state", gauges.scans)
    yield GaugeMetricFamily("nerfmodal_workers", "Workers that are alive.", gauges.workers)
    yield GaugeMetricFamily("nerfmodal_overdue_leases", "Running steps whose lease has expired.", gauges.overdue_leases)
    yield GaugeMetricFamily(
        "nerfmodal_oldest_webhook_seconds", "Wait of the oldest message to be delivered.", gauges.oldest_webhook_s
    )


def _by_one(name: str, words: str, label: str, values: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(name, words, labels=[label])
    for key, value in sorted(values.items()):
        family.add_metric([key], value)
    return family


def _has(total: Total, labels: Sequence[str], values: Sequence[str]) -> bool:
    return [total.labels[label] for label in labels] == list(values)
