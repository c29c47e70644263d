"""Totals count every attempt once, whoever counts; gauges say what the rows say; Prometheus can read both."""

import threading
from functools import partial

import pytest
from nerfmodal.spec import ScanSpec
from prometheus_client.parser import text_string_to_metric_families
from scanjobs import dispatch, leases, meters, repository, webhooks, workers
from scanjobs.account_tables import WebhookDelivery
from scanjobs.fanin import Output
from scanjobs.leases import Failure
from scanjobs.messages import QUEUES, RENDER
from scanjobs.meters import BEYOND, STEP_EDGES, Tally
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.tables import Attempt, Scan, Step
from scanjobs.telemetry import Telemetry, cumulate
from scanjobs.workers import WorkerIdentity
from sqlalchemy import delete, select, update

IDENTITY = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=2)
BROKEN = Failure(code="BROKEN", message="it broke.")


def totals(store: Store) -> dict[tuple[str, str], float]:
    with store.read() as session:
        return {(row.name, meters.as_text(row.labels)): row.value for row in meters.read_totals(session)}


def claim_some(store: Store) -> list[leases.Claim]:
    """Claims of what a worker of two slots is sent."""
    messages = store.write(dispatch.dispatch)
    claims = [store.write(partial(leases.claim, step_id=one.step_id, worker_id="w", lease_s=60.0)) for one in messages]
    return [claim for claim in claims if claim is not None]


@pytest.fixture
def claims(store: Store, spec: ScanSpec) -> list[leases.Claim]:
    """Three renders of a new scan, claimed."""
    store.write(lambda session: workers.register(session, IDENTITY, 600.0))
    store.write(lambda session: repository.insert_scan(session, spec))
    found = claim_some(store)
    assert [claim.kind for claim in found] == [RENDER] * 3
    return found


def end_all(store: Store, claims: list[leases.Claim]) -> None:
    """One succeeds with a file of 7 bytes and 40 rays, one fails, one is lost by its worker."""
    output = Output(role="frame", name="a", digest="0" * 64, size=7, media_type="text/plain")
    store.write(lambda session: leases.finish(session, claims[0], [output], {"rays": 40}))
    store.write(lambda session: leases.fail(session, claims[1], BROKEN, 3))
    store.write(
        lambda session: session.execute(update(Step).where(Step.id == claims[2].step_id).values(lease_until=1.0))
    )
    store.write(lambda session: leases.reap(session, claims[2].step_id, 3))


def test_every_ending_is_counted_once(store: Store, claims: list[leases.Claim]) -> None:
    end_all(store, claims)
    assert [store.write(meters.fold), store.write(meters.fold)] == [3, 0]
    found = totals(store)
    assert found["attempts", f"kind={RENDER},outcome=succeeded"] == 1
    assert found["attempts", f"kind={RENDER},outcome=failed"] == 1
    assert found["attempts", f"kind={RENDER},outcome=lease_expired"] == 1
    assert found["lease_expiries", f"kind={RENDER}"] == 1
    assert found["artifact_bytes_written", f"kind={RENDER}"] == 7
    assert found["rays", ""] == 40
    assert sum(value for (name, _), value in found.items() if name == "step_seconds_bucket") == 1
    assert ("retries", f"kind={RENDER}") not in found


def test_attempt_under_way_is_not_counted(store: Store, claims: list[leases.Claim]) -> None:
    assert claims
    with store.read() as session:
        assert not meters.has_uncounted(session)
    assert store.write(meters.fold) == 0


def test_second_claim_of_a_step_is_a_retry(store: Store, claims: list[leases.Claim]) -> None:
    end_all(store, claims)
    store.write(lambda session: session.execute(update(Step).values(not_before=None)))
    claim_some(store)
    [again] = [claim for claim in claim_some(store) + _running(store) if claim.step_id == claims[1].step_id]
    store.write(lambda session: leases.fail(session, again, BROKEN, 3))
    store.write(meters.fold)
    assert totals(store)["retries", f"kind={RENDER}"] == 1


def _running(store: Store) -> list[leases.Claim]:
    with store.read() as session:
        rows = session.execute(select(Step).where(Step.state == "running")).scalars().all()
    return [
        leases.Claim(
            step_id=row.id, scan_id=row.scan_id, token=row.token, attempt=row.attempt, kind=row.kind, frame=row.frame,
            spec={}, inputs=(),
        )
        for row in rows
    ]  # fmt: skip


def test_totals_stay_when_the_rows_are_deleted(store: Store, claims: list[leases.Claim]) -> None:
    end_all(store, claims)
    store.write(meters.fold)
    before = totals(store)
    store.write(lambda session: session.execute(delete(Scan)))
    with store.read() as session:
        assert session.scalars(select(Attempt.step_id)).all() == []
    assert totals(store) == before


def test_processes_that_count_together_count_once(store: Store, claims: list[leases.Claim]) -> None:
    end_all(store, claims)
    threads = [threading.Thread(target=lambda: store.write(partial(meters.fold, most=1))) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sum(value for (name, _), value in totals(store).items() if name == "attempts") == 3


def test_gauges_say_what_waits_and_runs(store: Store, claims: list[leases.Claim]) -> None:
    with store.read() as session:
        gauges = meters.read_gauges(session)
    assert gauges.steps["render", "running"] == len(claims)
    assert sum(gauges.steps.values()) == sum(1 for _ in _steps(store))
    assert gauges.scans["running"] == 1
    assert gauges.workers == 1
    assert gauges.slots == dict.fromkeys(QUEUES, 2)
    assert gauges.overdue_leases == 0


def _steps(store: Store) -> list[str]:
    with store.read() as session:
        return list(session.scalars(select(Step.id)))


def test_wait_grows_until_the_claim_and_a_lost_message_does_not_hide_it(store: Store, spec: ScanSpec) -> None:
    store.write(lambda session: workers.register(session, IDENTITY, 600.0))
    store.write(lambda session: repository.insert_scan(session, spec))
    store.write(lambda session: session.execute(update(Step).values(ready_at=Step.ready_at - 50.0)))
    messages = store.write(dispatch.dispatch)
    for one in messages:
        assert store.write(partial(dispatch.take_back, step_id=one.step_id))
    with store.read() as session:
        assert 50.0 <= meters.read_gauges(session).oldest_ready_s["render"] < 60.0
    claim_some(store)
    with store.read() as session:
        assert meters.read_gauges(session).oldest_ready_s["render"] == 0.0


def test_histogram_has_each_value_at_or_below_its_edge_and_cumulates() -> None:
    tally = Tally()
    for value in (0.1, 0.11, 2.0, 1e9):
        tally.observe("x", value, STEP_EDGES)
    counts = {labels.removeprefix("le="): count for (name, labels), count in tally.sums.items() if name == "x_bucket"}
    assert counts == {"0.1": 1, "0.3": 1, "3": 1, BEYOND: 1}
    buckets = dict(cumulate(counts, STEP_EDGES))
    assert [buckets[edge] for edge in ("0.1", "0.3", "1", "3", "10000", BEYOND)] == [1, 2, 2, 3, 3, 4]


def test_prometheus_reads_the_same_from_every_process(store: Store, claims: list[leases.Claim]) -> None:
    end_all(store, claims)
    store.write(meters.fold)
    first, second = (samples(Telemetry(Settings(), store)) for _ in range(2))
    own = ("nerfmodal_process_", "nerfmodal_disk", "process_", "nerfmodal_http")
    assert {key: value for key, value in first.items() if not key[0].startswith(own)} == {
        key: value for key, value in second.items() if not key[0].startswith(own)
    }
    assert first["nerfmodal_attempts_total", (("kind", RENDER), ("outcome", "failed"))] == 1
    assert first["nerfmodal_step_seconds_count", (("kind", RENDER),)] == 1
    assert first["nerfmodal_artifact_bytes", ()] == 7


def samples(telemetry: Telemetry) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    """Name and labels of every sample, as a scraper parses them."""
    text, content_type = telemetry.exposition()
    assert content_type.startswith("text/plain")
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text.decode())
        for sample in family.samples
        if not sample.name.endswith("_created") and family.name != "nerfmodal_oldest_ready_seconds"
    }


def test_database_that_is_away_is_told_and_does_not_fail_the_scrape(store: Store) -> None:
    telemetry = Telemetry(Settings(), store)
    store.write(lambda session: session.connection().exec_driver_sql("DROP TABLE meter"))
    found = samples(telemetry)
    assert found["nerfmodal_database_up", ()] == 0
    assert ("nerfmodal_workers", ()) not in found


def test_statements_are_timed(store: Store) -> None:
    telemetry = Telemetry(Settings(), store)
    with store.read() as session:
        session.execute(select(Scan.id)).all()
    found = samples(telemetry)
    assert found["nerfmodal_process_database_seconds_count", (("statement", "select"),)] >= 1


def test_webhooks_are_counted_and_the_oldest_message_is_aged(store: Store) -> None:
    endpoint = store.write(lambda session: webhooks.add_endpoint(session, owner="local", url="https://a.example/"))
    with store.read() as session:
        assert meters.read_gauges(session).oldest_webhook_s == 0.0
    for _ in range(3):
        store.write(lambda session: webhooks.enqueue(session, endpoint, kind="webhook.test", data={}))
    aged = update(WebhookDelivery).values(give_up_at=WebhookDelivery.give_up_at - 100.0)
    store.write(lambda session: session.execute(aged))
    with store.read() as session:
        assert 100.0 <= meters.read_gauges(session).oldest_webhook_s < 110.0
    outcomes = [webhooks.Outcome(took_s=0.1, status=204), webhooks.Outcome(took_s=0.1, status=500)]
    outcomes.append(webhooks.Outcome(took_s=0.1, error="timed out"))
    for claimed, outcome in zip(store.write(webhooks.claim_due), outcomes, strict=True):
        assert store.write(partial(webhooks.record, claimed=claimed, outcome=outcome))
    told = {labels: value for (name, labels), value in totals(store).items() if name == "webhook_attempts"}
    assert told == {"outcome=delivered": 1.0, "outcome=refused": 1.0, "outcome=unreachable": 1.0}
    with store.read() as session:
        assert meters.read_gauges(session).oldest_webhook_s > 0.0
    store.write(lambda session: webhooks.change_endpoint(session, endpoint.id, {"enabled": False}, owner="local"))
    with store.read() as session:
        assert meters.read_gauges(session).oldest_webhook_s == 0.0
