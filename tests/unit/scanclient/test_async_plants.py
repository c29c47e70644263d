"""The asynchronous fleet sends the requests of the synchronous one."""

import asyncio
import inspect

import httpx
from scanclient.calls import Call
from scanclient.plants import AsyncPlants, Plants

PLANT = {
    "id": "p",
    "name": "p",
    "treatment": None,
    "position": None,
    "study": None,
    "tags": [],
    "scans": 0,
    "last_scan": None,
    "frequencies": [],
    "ratio": None,
    "alarms": 0,
    "worst": None,
}


def test_both_send_the_same_and_follow_cursors() -> None:
    pages = [{"items": [PLANT], "next_cursor": "more"}, {"items": [PLANT], "next_cursor": None}]
    sent: list[Call] = []

    def send(call: Call) -> httpx.Response:
        sent.append(call)
        return httpx.Response(200, json=pages[(len(sent) - 1) % 2])

    async def send_later(call: Call) -> httpx.Response:
        return send(call)

    async def every() -> list[str]:
        return [plant.id async for plant in AsyncPlants(send_later).iterate(tag=["a"], alarm=True, sort="-ratio")]

    assert [plant.id for plant in Plants(send).iterate(tag=["a"], alarm=True, sort="-ratio")] == ["p", "p"]
    assert asyncio.run(every()) == ["p", "p"]
    assert sent[:2] == sent[2:]
    assert sent[1].params == {"sort": "-ratio", "limit": "200", "tag": ["a"], "alarm": "true", "cursor": "more"}


def test_what_both_have_takes_the_same_arguments() -> None:
    for name, method in vars(AsyncPlants).items():
        if not name.startswith("_"):
            assert inspect.signature(method).parameters == inspect.signature(getattr(Plants, name)).parameters
