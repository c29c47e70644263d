"""The clients against the real app over a real socket: files both ways, broken lines, waiting, both clients alike."""

import asyncio
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import stamina
from PIL import Image
from scanclient import AsyncClient, Client, Conflict, InvalidRequest, NotAllowed, NotFound, ScanCanceled
from scanclient import fetching as fetching_module
from scanclient.fetching import Fetcher
from scanclient.sending import Sender
from stamina.instrumentation import get_on_retry_hooks, set_on_retry_hooks

from tests.unit.api.live import live
from tests.unit.api.service import Service, simulation

ATTEMPTS = 6
"""As a client's own. On a busy machine the server lets go of a connection that was idle for 5 s while a request is on
its way: a piece that is sent but once is then lost."""


@pytest.fixture(autouse=True)
def _no_waiting() -> Iterator[None]:
    hooks = get_on_retry_hooks()
    set_on_retry_hooks([])
    stamina.set_testing(True, attempts=6, cap=True)
    yield
    stamina.set_testing(False)
    set_on_retry_hooks(hooks)


@pytest.fixture
def address(service: Service) -> Iterator[str]:
    with live(service.app()) as found:
        yield found


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = tmp_path / "pictures" / "fern"
    (folder / "a").mkdir(parents=True)
    for number in range(5):
        Image.effect_noise((64, 48), 60 + number).save(folder / "a" / f"{number}.png")
    (folder / ".hidden").write_text("x")
    return folder


def test_a_folder_becomes_a_capture_that_a_scan_reads(service: Service, address: str, pictures: Path) -> None:
    told: list[int] = []
    with Client(address) as client:
        capture = client.upload(pictures, on_bytes=told.append)
        scan = client.submit({"source": capture.source})
    assert (capture.name, capture.kind, capture.files) == ("fern", "capture", 5)
    stored = Path(scan.spec["source"]["path"])
    sent = {path.relative_to(pictures): path.read_bytes() for path in pictures.rglob("*.png")}
    assert {path.relative_to(stored): path.read_bytes() for path in stored.rglob("*.png")} == sent
    assert sum(told) == sum(len(content) for content in sent.values())
    assert not any(path.is_file() for path in service.settings.uploads.iterdir())


def test_an_upload_goes_on_where_a_program_was_killed(address: str, tmp_path: Path) -> None:
    path = tmp_path / "big.bin"
    path.write_bytes(os.urandom(1000))
    with Client(address) as client:
        killed = Sender(client._send, client._once, attempts=ATTEMPTS, piece_bytes=300)
        begun = killed._begin("big.bin", 1000)
        killed._send_piece(begun, path.read_bytes()[:300])
        told: list[int] = []
        again = Sender(client._send, client._once, attempts=3, piece_bytes=300)
        [upload] = again.send([("big.bin", path)], at_once=2, on_bytes=told.append)
    assert (upload.id, upload.complete, sum(told)) == (begun.id, True, 700)


def test_another_file_of_the_same_name_and_length_is_not_taken_for_it(address: str, tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    with Client(address) as client:
        sender = Sender(client._send, client._once, attempts=ATTEMPTS)
        ids = []
        for content in (b"first", b"other"):
            path.write_bytes(content)
            ids.append(sender.send([("a.bin", path)], at_once=1, on_bytes=None)[0].id)
    assert ids[0] != ids[1]


def test_what_cannot_be_a_capture_is_refused_by_name(address: str, tmp_path: Path) -> None:
    folder = tmp_path / "bad"
    folder.mkdir()
    (folder / "run.sh").write_text("rm")
    with Client(address) as client, pytest.raises(InvalidRequest, match=r"run\.sh") as refused:
        client.upload(folder)
    assert refused.value.code == "INVALID_CAPTURE"


@pytest.mark.parametrize("piece_bytes", [1000, 4096, 10**9])
def test_large_files_come_in_ranges_beside_one_another(
    service: Service, address: str, tmp_path: Path, piece_bytes: int
) -> None:
    content = {f"figures/{number}.png": os.urandom(10_000 + number) for number in range(3)} | {"e.csv": b""}
    scan = service.submit()["id"]
    service.give(scan, content)
    with Client(address) as client:
        fetcher = Fetcher(client._http, scan, attempts=3, piece_bytes=piece_bytes)
        fetcher.fetch(client.artifacts(scan), tmp_path / "out", at_once=3)
    out = tmp_path / "out"
    found = {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert found == content


def test_ranges_go_on_where_they_stopped(service: Service, address: str, tmp_path: Path) -> None:
    body = os.urandom(10_000)
    scan = service.submit()["id"]
    service.give(scan, {"a.bin": body})
    with Client(address) as client:
        [artifact] = client.artifacts(scan)
        part = tmp_path / f".a.bin.{artifact.sha256[:12]}.part"
        (tmp_path / f"{part.name}.4000").write_bytes(body[4000:5000])
        Fetcher(client._http, scan, attempts=ATTEMPTS, piece_bytes=4000).fetch([artifact], tmp_path, at_once=2)
    assert (tmp_path / "a.bin").read_bytes() == body
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".a")] == []


def test_rotten_ranges_are_fetched_again(service: Service, address: str, tmp_path: Path) -> None:
    body = os.urandom(10_000)
    scan = service.submit()["id"]
    service.give(scan, {"a.bin": body})
    with Client(address) as client:
        [artifact] = client.artifacts(scan)
        part = tmp_path / f".a.bin.{artifact.sha256[:12]}.part"
        (tmp_path / f"{part.name}.4000").write_bytes(b"x" * 4000)
        Fetcher(client._http, scan, attempts=ATTEMPTS, piece_bytes=4000).fetch([artifact], tmp_path, at_once=2)
    assert (tmp_path / "a.bin").read_bytes() == body


def test_several_files_are_under_way_at_once(
    service: Service, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scan = service.submit()["id"]
    service.give(scan, {f"{number}.csv": b"x" for number in range(4)})
    together = threading.Barrier(4, timeout=20)
    fetch_rest = Fetcher._fetch_rest

    def wait_for_all(self: Fetcher, *given: Any, **named: Any) -> None:
        together.wait()
        fetch_rest(self, *given, **named)

    monkeypatch.setattr(fetching_module.Fetcher, "_fetch_rest", wait_for_all)
    with Client(address) as client:
        assert len(client.download(scan, tmp_path / "out", at_once=4)) == 4


def test_both_clients_say_the_same(service: Service, address: str, tmp_path: Path) -> None:
    scan = service.submit(simulation(tags=["a"]))["id"]
    service.give(scan, {"modes.json": b'{"organs": []}'})

    async def ask() -> list[Any]:
        async with AsyncClient(address) as client:
            listed = [one async for one in client.iterate(tag="a")]
            files = await client.download(scan, tmp_path / "async")
            with pytest.raises(NotFound):
                await client.get("0190c0de-0000-7000-8000-000000000000")
            with pytest.raises(Conflict):
                await client.retry(scan)
            fork = await client.fork(scan, {"seed": 5})
            return [await client.get(scan), listed, await client.modes(scan), await client.artifacts(scan), len(files),
                    await client.logs(scan), fork.spec["seed"], (await client.info())["name"]]  # fmt: skip

    with Client(address) as client:
        listed = list(client.iterate(tag="a"))
        files = client.download(scan, tmp_path / "sync")
        expected = [client.get(scan), listed, client.modes(scan), client.artifacts(scan), len(files), client.logs(scan),
                    client.fork(scan, {"seed": 5}).spec["seed"], client.info()["name"]]  # fmt: skip
    found = asyncio.run(ask())
    assert found[1][-1].id == scan
    found[1], expected[1] = found[1][-1:], expected[1][-1:]
    assert found == expected


def test_a_scan_waits_for_itself(address: str) -> None:
    seen: list[str] = []

    async def follow() -> None:
        async with AsyncClient(address) as client:
            scan = await client.submit(simulation())
            await client.cancel(scan.id)
            await scan.wait(on_progress=lambda one: seen.append(one.status), poll_s=0.05)

    with pytest.raises(ScanCanceled):
        asyncio.run(follow())
    with Client(address) as client, pytest.raises(ScanCanceled):
        scan = client.submit(simulation())
        client.cancel(scan.id)
        scan.wait(on_progress=lambda one: seen.append(one.status), poll_s=0.05, timeout_s=30)
    assert seen[-1] == "canceled"


def test_a_wrong_key_is_a_typed_refusal(address: str) -> None:
    with Client(address, key="nm_" + "a" * 43) as client, pytest.raises(NotAllowed) as refused:
        client.info()
    assert (refused.value.status, refused.value.code) == (401, "UNAUTHORIZED")
