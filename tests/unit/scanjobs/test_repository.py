"""Submitting, listing and looking, each in the name of its owner."""

import contextlib
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nerfmodal.spec import ScanSpec
from scanjobs import control, repository
from scanjobs.errors import IdempotencyConflict, IllegalTransition, InvalidCursor, NotFound
from scanjobs.repository import Idempotency, Page
from scanjobs.states import ScanState
from scanjobs.store import Store
from scanjobs.tables import Scan
from sqlalchemy import func, select


def submit(store: Store, spec: ScanSpec, *, owner: str = "local", key: str | None = None, body: str = "b") -> Scan:
    """Insert one scan."""
    idempotency = Idempotency(key, body) if key else None
    return store.write(lambda session: repository.insert_scan(session, spec, owner=owner, idempotency=idempotency)).scan


def listed(store: Store, *, owner: str = "local", tag: str | None = None, plant: str | None = None) -> list[str]:
    """Ids found with a filter."""
    with store.read() as session:
        page = repository.list_scans(session, owner=owner, tag=tag, plant_id=plant)
    return [scan.id for scan in page.items]


def test_scan_keeps_its_specification(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec)
    assert ScanSpec.model_validate(scan.spec) == spec
    assert (scan.state, scan.frames, scan.plant, scan.spec_digest) == ("queued", 3, "acai-7", spec.digest())
    assert [tag.tag for tag in scan.tags] == ["dry", "wind"]


def test_pages_hold_every_scan_once_newest_first(store: Store, spec: ScanSpec) -> None:
    ids = [submit(store, spec).id for _ in range(7)]
    seen: list[str] = []
    cursor: str | None = None
    while True:
        with store.read() as session:
            page: Page = repository.list_scans(session, cursor=cursor, limit=3)
        seen += [scan.id for scan in page.items]
        cursor = page.next_cursor
        if cursor is None:
            break
    assert seen == ids[::-1]


def test_filters_find_what_they_name(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec)
    plain = submit(store, spec.model_copy(update={"tags": (), "plant": None}))
    assert listed(store, tag="dry") == [scan.id]
    assert listed(store, plant="acai-7") == [scan.id]
    assert listed(store) == [plain.id, scan.id]
    store.write(lambda session: control.cancel_scan(session, plain.id))
    with store.read() as session:
        page = repository.list_scans(session, states=[ScanState.CANCELED])
    assert [one.id for one in page.items] == [plain.id]


def test_what_belongs_to_another_owner_does_not_exist(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec, owner="a")
    assert listed(store, owner="b") == []
    with store.read() as session, pytest.raises(NotFound):
        repository.get_scan(session, scan.id, owner="b")
    with pytest.raises(NotFound):
        store.write(lambda session: control.cancel_scan(session, scan.id, owner="b"))
    with pytest.raises(NotFound):
        store.write(lambda session: control.retry_scan(session, scan.id, owner="b"))


@given(text=st.text(max_size=80))
def test_any_text_is_a_cursor_or_is_refused(text: str) -> None:
    with contextlib.suppress(InvalidCursor):
        assert len(repository._read_cursor(text)) == 36


def test_own_cursor_is_read_back() -> None:
    scan_id = repository.new_id()
    assert repository._read_cursor(repository._write_cursor(scan_id)) == scan_id


def test_one_key_makes_one_scan_even_in_parallel(store: Store, spec: ScanSpec) -> None:
    barrier = threading.Barrier(20)
    ids: list[str] = []

    def post() -> None:
        barrier.wait()
        ids.append(submit(store, spec, key="k").id)

    threads = [threading.Thread(target=post) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(ids) == 20
    assert len(set(ids)) == 1
    with store.read() as session:
        assert session.scalars(select(func.count()).select_from(Scan)).one() == 1


def test_key_with_another_body_is_refused(store: Store, spec: ScanSpec) -> None:
    submit(store, spec, key="k", body="one")
    with pytest.raises(IdempotencyConflict):
        submit(store, spec, key="k", body="two")


def test_key_belongs_to_its_owner(store: Store, spec: ScanSpec) -> None:
    assert submit(store, spec, owner="a", key="k").id != submit(store, spec, owner="b", key="k").id


def test_insert_is_all_or_nothing(store: Store, spec: ScanSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("the plan cannot be stored")

    monkeypatch.setattr(repository, "plant_rest", broken)
    with pytest.raises(RuntimeError):
        submit(store, spec, key="k")
    monkeypatch.undo()
    assert listed(store) == []
    assert submit(store, spec, key="k").state == "queued"


def test_summaries_count_the_present_generation(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec)
    store.write(lambda session: control.cancel_scan(session, scan.id))
    scan = store.write(lambda session: control.retry_scan(session, scan.id))
    with store.read() as session:
        summaries = repository.step_summaries(session, scan)
        events = repository.list_events(session, scan, after=0)
    assert [(one.kind, one.total, one.done, one.fraction) for one in summaries] == [
        ("frame.render", 3, 0, 0.0),
        ("frame.train", 4, 0, 0.0),
        ("frame.extract", 3, 0, 0.0),
        ("scan.identify", 1, 0, 0.0),
    ]
    assert [event.to_state for event in events if event.step_id is None] == [
        "queued",
        "canceling",
        "canceled",
        "queued",
    ]


def test_events_can_be_read_on_from_any_of_them(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec)
    with store.read() as session:
        events = repository.list_events(session, scan)
        rest = repository.list_events(session, scan, after=events[3].id)
    assert [event.id for event in rest] == [event.id for event in events[4:]]


def test_retry_refuses_a_kind_that_the_scan_does_not_have(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec)
    store.write(lambda session: control.cancel_scan(session, scan.id))
    with pytest.raises(IllegalTransition, match=r"frame\.read"):
        store.write(lambda session: control.retry_scan(session, scan.id, from_kind="frame.read"))


def test_scan_that_runs_cannot_be_retried(store: Store, spec: ScanSpec) -> None:
    scan = submit(store, spec)
    with pytest.raises(IllegalTransition):
        store.write(lambda session: control.retry_scan(session, scan.id))
