"""Downloads against a scripted server: digests, resuming, names that climb."""

import hashlib
import re
from pathlib import Path

import pytest
from scanclient import Artifact, BrokenDownload, Client

from tests.unit.scanclient.scripted import Heard, Reply, ScriptedServer, json_reply

BODY = bytes(range(256)) * 40


def listed(name: str = "figures/psd.png", body: bytes = BODY, step: str = "scan.identify") -> dict[str, object]:
    digest = hashlib.sha256(body).hexdigest()
    kind = "image/png"
    return {"name": name, "step": step, "role": name, "size": len(body), "sha256": digest, "media_type": kind}


def serve(server: ScriptedServer, *rows: dict[str, object], file: Reply | None = None, ranges: bool = True) -> None:
    def script(heard: Heard) -> Reply:
        if heard.path.endswith("/artifacts"):
            return json_reply({"items": list(rows)})
        asked = re.fullmatch(r"bytes=(\d+)-", heard.headers.get("Range", ""))
        if file is not None:
            return file
        if asked and ranges:
            return Reply(status=206, body=BODY[int(asked[1]) :])
        return Reply(body=BODY)

    server.script = script


def files(server: ScriptedServer) -> list[Heard]:
    return [heard for heard in server.heard if not heard.path.endswith("/artifacts")]


def test_a_file_arrives_under_its_relative_name(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed())
    done: list[Artifact] = []
    with Client(server.address) as client:
        [path] = client.download("s", tmp_path, on_file=done.append)
    assert path == tmp_path / "figures" / "psd.png"
    assert path.read_bytes() == BODY
    assert [artifact.name for artifact in done] == ["figures/psd.png"]
    assert list(tmp_path.rglob("*.part")) == []


def test_only_results_are_fetched_unless_asked(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed("a.json"), listed("frames/frame_0000.zip", step="frame.render"))
    with Client(server.address) as client:
        assert len(client.download("s", tmp_path)) == 1
        assert len(client.download("s", tmp_path, select=lambda _: True)) == 2


def test_a_broken_transfer_goes_on_where_it_stopped(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed())
    whole = server.script
    server.script = lambda heard: (
        Reply(body=BODY, cut=4000) if len(files(server)) == 1 and "png" in heard.path else whole(heard)
    )
    with Client(server.address) as client:
        [path] = client.download("s", tmp_path)
    assert path.read_bytes() == BODY
    assert [heard.headers.get("Range") for heard in files(server)] == [None, f"bytes={len(BODY) - 4000}-"]


def test_a_server_that_ignores_ranges_still_gives_the_right_file(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed(), ranges=False)
    digest = hashlib.sha256(BODY).hexdigest()
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / f".psd.png.{digest[:12]}.part").write_bytes(BODY[:100])
    with Client(server.address) as client:
        [path] = client.download("s", tmp_path)
    assert path.read_bytes() == BODY


def test_a_rotten_part_file_is_thrown_away_and_the_file_fetched_whole(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed())
    digest = hashlib.sha256(BODY).hexdigest()
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / f".psd.png.{digest[:12]}.part").write_bytes(b"x" * 100)
    with Client(server.address) as client:
        [path] = client.download("s", tmp_path)
    assert path.read_bytes() == BODY
    assert [heard.headers.get("Range") for heard in files(server)] == ["bytes=100-", None]


def test_what_is_there_is_not_fetched_again(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed())
    with Client(server.address) as client:
        client.download("s", tmp_path)
        client.download("s", tmp_path)
    assert len(files(server)) == 1


def test_wrong_bytes_are_refused_and_removed(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed(), file=Reply(body=BODY[::-1]))
    with Client(server.address) as client, pytest.raises(BrokenDownload, match="digest"):
        client.download("s", tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("name", ["../evil", "a/../../evil", "/etc/evil", "a\\..\\evil", ""])
def test_a_name_that_climbs_out_writes_nothing(server: ScriptedServer, tmp_path: Path, name: str) -> None:
    serve(server, listed(name))
    with Client(server.address) as client, pytest.raises(BrokenDownload, match="leave"):
        client.download("s", tmp_path / "in")
    assert list(tmp_path.rglob("*")) == []
    assert files(server) == []


def test_an_empty_file_is_a_file(server: ScriptedServer, tmp_path: Path) -> None:
    serve(server, listed(body=b""), file=Reply(body=b""))
    with Client(server.address) as client:
        [path] = client.download("s", tmp_path)
    assert path.read_bytes() == b""
