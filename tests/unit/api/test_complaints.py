"""For every key there is: break it, and the complaint points at it with a remedy."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from nerfmodal.spec import ScanSpec
from pydantic import ValidationError

from services.api.complaints import Complaint, complaints_of, json_pointer
from services.api.presets import QUICK

Path = tuple[str | int, ...]
FULL = QUICK.model_dump(mode="json") | {
    "organs": [{"name": "leaf", "region": {"center_m": [0, 0, 0], "size_m": [1, 1, 1]}}],
    "plant": {"id": "p"},
}
FULL["source"]["motion"] = FULL["source"]["motion"][:1]


def paths(value: Any, path: Path = ()) -> Iterator[Path]:
    """Every key and item of a document."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield (*path, key)
        yield from paths(child, (*path, key))


def complaints_about(document: Any) -> tuple[Complaint, ...]:
    with pytest.raises(ValidationError) as refused:
        ScanSpec.model_validate(document)
    return complaints_of(refused.value)


def broken(path: Path, value: Any) -> Any:
    document = json.loads(json.dumps(FULL))
    at = document
    for part in path[:-1]:
        at = at[part]
    at[path[-1]] = value
    return document


@pytest.mark.parametrize("path", list(paths(FULL)), ids=json_pointer)
def test_nonsense_at_any_key_is_found_there(path: Path) -> None:
    found = complaints_about(broken(path, {"nonsense": [None]}))
    assert all(row.pointer.startswith(json_pointer(path)) for row in found)
    assert all(row.hint.endswith((".", "?")) and row.message.endswith(".") for row in found)
    assert not any("{" in row.hint for row in found)


@pytest.mark.parametrize("path", [path for path in paths(FULL) if isinstance(path[-1], str)], ids=json_pointer)
def test_an_unknown_key_beside_any_key_is_found_and_the_known_one_offered(path: Path) -> None:
    name = f"{path[-1]}_"
    [row] = complaints_about(broken((*path[:-1], name), 1))
    assert row.pointer == json_pointer((*path[:-1], name))
    assert row.hint.startswith(f"Did you mean '{path[-1]}'?")


def test_a_pointer_escapes_what_rfc_6901_escapes() -> None:
    assert json_pointer(("a/b", "c~d", 0)) == "/a~1b/c~0d/0"


@pytest.mark.parametrize(
    ("change", "pointer", "hint"),
    [
        ({"organs": [{"name": "a"}, {"name": "a"}]}, "/organs", "Give each its own name."),
        ({"source": {"kind": "film"}}, "/source/kind", "simulation"),
        ({"source": {}}, "/source/kind", "one of simulation"),
        ({"source": {"kind": "simulation", "simulation": 1}}, "/source/simulation", "keys here"),
        ({"reconstruction": {"ground_m": "floor"}}, "/reconstruction/ground_m", "Give a value"),
    ],
)
def test_faults_of_the_whole_are_pointed_at(change: dict[str, Any], pointer: str, hint: str) -> None:
    assert any(row.pointer == pointer and hint in row.hint for row in complaints_about(FULL | change))
