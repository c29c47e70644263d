"""What a worker does beside steps: plant the rest of long plans, join plants' scans, submit what schedules ask
for, pause what has no room, collect garbage.

Each is guarded in the database, so that it does no harm when every worker does it; what takes long has a thread of
its own, because the ticker must not wait.
"""

import logging
import threading
import time
from functools import partial
from typing import Final

from scanjobs import chores, pausing
from scanjobs.artifacts import ArtifactStore
from scanjobs.disk import has_room, is_low
from scanjobs.fanin import plant_next_chunk, unplanted_scans
from scanjobs.fleet.joining import join, touched_plants
from scanjobs.fleet.schedules import due_schedules, run_due
from scanjobs.garbage import collect_garbage, drop_checkpoints, sweep_staging
from scanjobs.pausing import Cause
from scanjobs.settings import Settings
from scanjobs.store import Store

log = logging.getLogger(__name__)

PLANTING_S: Final = 0.5
"""Of one tick at most, spent on planting."""
JOINING_S: Final = 0.5
"""Of one tick at most, spent on joining plants."""
AILING_S: Final = 60.0
QUOTA_S: Final = 30.0
DAY_S: Final = 24 * 3600.0


class Chores:
    """The chores of one worker; `run` is called by every tick."""

    def __init__(self, store: Store, artifacts: ArtifactStore, settings: Settings) -> None:
        self._store = store
        self._artifacts = artifacts
        self._settings = settings
        self._asked_at = 0.0
        self._ailing: dict[str, float] = {}
        self._collecting: threading.Thread | None = None

    def run(self) -> None:
        """Everything that is due."""
        self._plant()
        self._join()
        self._watch_disk()
        if time.monotonic() - self._asked_at < min(QUOTA_S, self._settings.collect_every_s):
            return
        self._asked_at = time.monotonic()
        self._submit_due()
        if self._is_mine("quota", QUOTA_S):
            self._store.write(lambda session: pausing.hold_to_quota(session, self._settings.scan_quota))
        if self._is_mine("collect", self._settings.collect_every_s):
            self._begin_to_collect()

    def _plant(self) -> None:
        deadline = time.monotonic() + PLANTING_S
        with self._store.read() as session:
            waiting = list(unplanted_scans(session))
        while waiting and time.monotonic() < deadline:
            if not self._store.write(partial(plant_next_chunk, scan_id=waiting[0])):
                waiting.pop(0)

    def _join(self) -> None:
        """Plants whose scans have ended, one after the other for a moment; several workers may, with one outcome."""
        deadline = time.monotonic() + JOINING_S
        with self._store.read() as session:
            waiting = [key for key in touched_plants(session) if self._ailing.get(key, 0.0) < time.monotonic()]
        while waiting and time.monotonic() < deadline:
            key = waiting.pop(0)
            try:
                join(self._store, self._artifacts, key)
            except Exception:  # one plant's trouble is not the others'; it stays touched and is tried again
                log.exception("the scans of plant %s could not be joined; next try in %g s", key, AILING_S)
                self._ailing[key] = time.monotonic() + AILING_S

    def _submit_due(self) -> None:
        """Scans that schedules ask for; a source that is not there yet is looked for again at the next time."""
        with self._store.read() as session:
            due = due_schedules(session)
        for schedule_id in due:
            self._store.write(partial(run_due, settings=self._settings, schedule_id=schedule_id))

    def _watch_disk(self) -> None:
        if is_low(self._settings):
            self._store.write(lambda session: pausing.pause_all(session, Cause.DISK_LOW))
        elif has_room(self._settings):
            self._store.write(lambda session: pausing.resume_all(session, Cause.DISK_LOW))

    def _is_mine(self, name: str, every_s: float) -> bool:
        return self._store.write(lambda session: chores.is_mine(session, name, every_s))

    def _begin_to_collect(self) -> None:
        if self._collecting is None or not self._collecting.is_alive():
            self._collecting = threading.Thread(target=self._collect, name="garbage", daemon=True)
            self._collecting.start()

    def _collect(self) -> None:
        try:
            dropped = drop_checkpoints(self._store, self._settings.keep_checkpoints_days * DAY_S)
            removed = collect_garbage(self._store, self._artifacts)
            swept = sweep_staging(self._settings)
        except Exception:  # it is tried again at the next interval; a thread that dies silently would never be missed
            log.exception("the garbage could not be collected")
        else:
            log.info("dropped %d old checkpoints, removed %d files and %d leftovers", dropped, len(removed), swept)
