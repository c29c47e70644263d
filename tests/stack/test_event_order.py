"""Events of transactions that overlap: a reader who follows them misses none, whoever commits first."""

from scanjobs.event_log import BEGINNING, last_place, read_events
from scanjobs.migrate import upgrade
from scanjobs.repository import insert_scan
from scanjobs.settings import Settings
from scanjobs.store import open_store
from sqlalchemy.orm import Session

from tests.integration.toy_service import toy_spec


def test_a_transaction_that_took_its_ids_first_and_commits_last_is_not_missed(settings: Settings) -> None:
    """Guard: `settled_before` in `read_events`.

    Seen to fail: without it the reader is told of the second scan before the first is committed, and stands behind its
    events.
    """
    upgrade(settings.database)
    store = open_store(settings.database)
    with Session(store.engine) as slow, Session(store.engine) as fast:
        first = insert_scan(slow, toy_spec(frames=1)).scan.id
        slow.flush()
        other = toy_spec(frames=1).model_copy(update={"plant": None})  # scans of one plant wait for each other
        second = insert_scan(fast, other).scan.id
        fast.commit()
        with store.read() as session:
            early = read_events(session, BEGINNING)
            place = early[-1].place if early else BEGINNING
            assert last_place(session) == place
        slow.commit()
    with store.read() as session:
        late = read_events(session, place)
    assert {one.scan_id for one in early + late} == {first, second}
    assert [one.place for one in early + late] == sorted({one.place for one in early + late})
    store.close()
