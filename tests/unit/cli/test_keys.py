"""`keys …`, and the refusal to listen to other machines while nobody has a key."""

import json
from pathlib import Path

import pytest
from scanjobs.owners import authenticate
from scanjobs.settings import Settings
from scanjobs.store import open_store

from services.cli.up import KeysNeeded, asking_for_keys, is_loopback
from tests.unit.cli.conftest import Call


def opens(folder: Path, secret: str) -> bool:
    store = open_store(Settings(data_folder=folder).database)
    with store.read() as session:
        found = authenticate(session, secret)
    store.close()
    return found is not None


def test_a_key_is_made_listed_rotated_and_revoked(call: Call, tmp_path: Path) -> None:
    made = call("keys", "create", "--owner", "greenhouse", "--name", "robot", "--data", tmp_path / "d")
    secret = made.output.strip()
    assert opens(tmp_path / "d", secret)
    listed = call("keys", "list", "--data", tmp_path / "d", "--json")
    [row] = json.loads(listed.output)
    assert (row["owner"], row["name"], row["scopes"]) == ("greenhouse", "robot", ["read", "submit"])
    assert secret not in listed.output
    arguments = ("--owner", "greenhouse", "--data", tmp_path / "d")
    new = call("keys", "rotate", row["id"], "--grace-hours", "0", *arguments).output.strip()
    assert not opens(tmp_path / "d", secret)
    assert opens(tmp_path / "d", new)
    newest = json.loads(call("keys", "list", "--owner", "greenhouse", "--data", tmp_path / "d", "--json").output)[0]
    assert call("keys", "revoke", newest["id"], *arguments).exit_code == 0
    assert not opens(tmp_path / "d", new)


def test_a_key_of_somebody_else_is_not_there(call: Call, tmp_path: Path) -> None:
    call("keys", "create", "--owner", "a", "--data", tmp_path)
    [row] = json.loads(call("keys", "list", "--data", tmp_path, "--json").output)
    refused = call("keys", "revoke", row["id"], "--owner", "b", "--data", tmp_path)
    assert (refused.exit_code, "no key" in refused.output) == (1, True)


def test_other_machines_are_not_let_in_without_keys(call: Call, tmp_path: Path) -> None:
    settings = Settings(data_folder=tmp_path)
    with pytest.raises(KeysNeeded, match="API key"):
        asking_for_keys(settings)
    call("keys", "create", "--data", tmp_path)
    assert asking_for_keys(settings).keyless is False


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False)],
)
def test_loopback_is_what_only_this_machine_reaches(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
