"""The client against the real API on a real socket, over the same database."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn
from scanclient import Client, Conflict, InvalidRequest, NotFound

from services.api.app import create_app
from services.cli.up import listen
from tests.unit.api.service import Service, simulation


@pytest.fixture
def client(service: Service) -> Iterator[Client]:
    app = create_app(service.settings, service.store, service.artifacts)
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning"))
    with listen(0) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        with Client(f"http://127.0.0.1:{listener.getsockname()[1]}") as client:
            yield client
        server.should_exit = True
        thread.join()


def test_what_was_submitted_is_what_is_seen(client: Client) -> None:
    scan = client.submit(simulation(tags=["a"], plant={"id": "p"}), "k")
    assert client.submit(simulation(tags=["a"], plant={"id": "p"}), "k").id == scan.id
    assert client.get(scan.id) == scan
    assert (scan.status, scan.tags, scan.plant, scan.source) == ("queued", ("a",), "p", "simulation")
    assert {row.step: row.total for row in scan.progress}["frame.train"] == 4
    assert scan.spec["source"]["frames"] == 3
    [listed] = client.list(status="queued", plant="p", tag="a").items
    assert listed.id == scan.id


def test_every_page_is_walked(client: Client) -> None:
    made = [client.submit(simulation()).id for _ in range(3)]
    first = client.list(limit=2)
    rest = client.list(limit=2, cursor=first.next_cursor)
    assert [scan.id for scan in (*first.items, *rest.items)] == made[::-1]
    assert [scan.id for scan in client.iterate()] == made[::-1]


def test_refusals_are_typed(client: Client) -> None:
    with pytest.raises(InvalidRequest) as refused:
        client.submit(simulation(colour="red"))
    assert (refused.value.code, refused.value.pointer) == ("INVALID_SPEC", "/colour")
    with pytest.raises(NotFound):
        client.get("0190c0de-0000-7000-8000-000000000000")
    scan = client.submit(simulation()).id
    assert client.cancel(scan).status == "canceled"
    with pytest.raises(Conflict):
        client.cancel(scan)
    assert client.retry(scan, "frame.train").generation == 1


def test_downloads_resume_where_a_part_file_ends(client: Client, service: Service, tmp_path: Path) -> None:
    content = bytes(range(256)) * 1000
    scan = client.submit(simulation()).id
    service.give(scan, {"modes.json": b'{"organs": []}', "figures/a.png": content})
    service.give(scan, {"frame": b"zip"}, kind="frame.render", frame=1)
    [digest] = [row.sha256 for row in client.artifacts(scan) if row.name == "figures/a.png"]
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    (out / "figures" / f".a.png.{digest[:12]}.part").write_bytes(content[:1000])
    paths = client.download(scan, out)
    assert {path.relative_to(out).as_posix() for path in paths} == {"modes.json", "figures/a.png"}
    assert (out / "figures/a.png").read_bytes() == content
    assert client.modes(scan) == {"organs": []}
    assert len(client.download(scan, out, select=lambda _: True)) == 3


def test_the_service_tells_of_itself(client: Client) -> None:
    assert client.info()["database"] == "sqlite"
    assert {preset["name"] for preset in client.presets()["items"]} >= {"quick", "paper"}
