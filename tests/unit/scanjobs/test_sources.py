"""No specification can name a file outside the roots, however the path is spelt."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nerfmodal.spec import ScanSpec
from scanjobs.errors import SourceOutsideRoots
from scanjobs.settings import Settings
from scanjobs.sources import confine_source, resolve_source_path


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A root with a capture in it, links that stay and links that leave, and a secret beside it."""
    base = tmp_path_factory.mktemp("base")
    inside = base / "root"
    (inside / "fox").mkdir(parents=True)
    (base / "secret").mkdir()
    (base / "root-of-another").mkdir()
    (inside / "stays").symlink_to(inside / "fox")
    (inside / "leaves").symlink_to(base / "secret")
    (inside / "loop").symlink_to(inside / "loop")
    return inside


def confined(root: Path) -> Settings:
    """Settings with one root."""
    return Settings(capture_roots=(root,))


@pytest.mark.parametrize("path", ["fox", "./fox", "fox/../fox", "stays"])
def test_paths_inside_are_resolved(root: Path, path: str) -> None:
    """Guard: `resolve` in `_inside`. Seen to fail: joined alone, the path of a link is the link's."""
    assert resolve_source_path(confined(root), path) == (root / "fox").resolve()
    assert resolve_source_path(confined(root), str(root / path)) == (root / "fox").resolve()


@pytest.mark.parametrize(
    "path", ["..", "../secret", "leaves", "loop", "/etc", "fox/../../secret", "../root-of-another", "nothing", "a\x00b"]
)
def test_paths_that_leave_or_lead_nowhere_are_refused(root: Path, path: str) -> None:
    """Guards, each of them in `_inside` but for the zero byte.

    Seen to fail: without `is_relative_to` the secret beside the root is found; with `startswith` in its place
    `root-of-another` is; without `strict` what does not exist is; without `RuntimeError` a loop of links raises; and
    without its own question a zero byte does.
    """
    with pytest.raises(SourceOutsideRoots) as refusal:
        resolve_source_path(confined(root), path)
    assert refusal.value.where == "/source/path"
    assert str(root) in (refusal.value.hint or "")


@given(parts=st.lists(st.sampled_from(["..", ".", "fox", "stays", "leaves", "secret", "root", "/"]), max_size=6))
def test_no_spelling_escapes(root: Path, parts: list[str]) -> None:
    """Guard: `is_relative_to`. Seen to fail: without it hypothesis finds `..`."""
    try:
        found = resolve_source_path(confined(root), "/".join(parts))
    except SourceOutsideRoots:
        return
    assert found.is_relative_to(root.resolve())


def test_specification_carries_the_resolved_path(root: Path) -> None:
    """Guard: `confine_source`, so that a worker need not follow a link that leads elsewhere by then.

    Seen to fail: with the specification as it came its path is the link's.
    """
    spec = ScanSpec.model_validate({"source": {"kind": "capture", "path": "stays"}})
    source = confine_source(confined(root), spec).source
    assert source.kind == "capture"
    assert source.path == str((root / "fox").resolve())


def test_other_owners_read_from_the_folder_of_their_name_alone(root: Path) -> None:
    """Guard: `roots_of`. Seen to fail: with the roots themselves every owner reads every other's pictures."""
    for owner in ("anna", "bert"):
        (root / owner / "fern").mkdir(parents=True, exist_ok=True)
    settings = confined(root)
    assert resolve_source_path(settings, "fern", owner="anna") == (root / "anna" / "fern").resolve()
    for path in ("../bert/fern", str(root / "bert" / "fern"), "bert/fern", "fox", str(root / "fox"), ".."):
        with pytest.raises(SourceOutsideRoots):
            resolve_source_path(settings, path, owner="anna")
    assert resolve_source_path(settings, "bert/fern") == (root / "bert" / "fern").resolve()


def test_roots_come_from_one_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Guard: `Settings._split_roots`. Seen to fail: without it there is one root called `/a:/b`."""
    monkeypatch.setenv("NERFMODAL_CAPTURE_ROOTS", "/a:/b")
    assert Settings().capture_roots == (Path("/a"), Path("/b"))
