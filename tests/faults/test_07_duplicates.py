"""Fault 7: each message is delivered three times, in no order."""

import random
import threading

import pytest
from celery import Celery
from scanjobs.messages import Message
from scanjobs.queue import publish
from scanjobs.settings import Settings

from services.worker import ticker
from tests.faults.steps import assert_whole
from tests.integration.toy_service import serving, toy_spec


class Echo:
    """A broker that delivers every message three times, and old ones between new ones."""

    def __init__(self) -> None:
        self._chance = random.Random(7)
        self._said: list[Message] = []
        self._lock = threading.Lock()

    def __call__(self, app: Celery, message: Message) -> None:
        """Deliver this one once and two older ones again."""
        with self._lock:
            self._said.append(message)
            heard = [message, *self._chance.choices(self._said, k=2)]
        self._chance.shuffle(heard)
        for one in heard:
            publish(app, one)


def test_messages_heard_three_times_are_computed_once(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Promise (b): every step has its first token at the end.

    Guard: only a `sent` step can be claimed, by a move that names the state it starts from (`leases.claim`).
    Seen to fail: with the look at the state removed from `claim` and `is_sent`, and running → running allowed in the
    table of moves, steps are claimed again while they compute, and fsck finds their first attempts without an end.
    """
    monkeypatch.setattr(ticker, "publish", Echo())
    with serving(settings) as service:
        scan_id = service.submit(toy_spec(frames=6))
        assert_whole(service, scan_id)
        assert {step.token for step in service.steps(scan_id)} == {1}
