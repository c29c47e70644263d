"""The content-addressed store: whole or absent, never another's bytes."""

import hashlib
import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scanjobs import artifacts
from scanjobs.artifacts import ArtifactStore, place_input, stored_as
from scanjobs.errors import ArtifactDamaged, NotFound


@pytest.fixture
def files(tmp_path: Path) -> ArtifactStore:
    """An empty store."""
    return ArtifactStore(tmp_path / "artifacts")


def written(folder: Path, content: bytes) -> Path:
    """A file to store."""
    path = folder / "file"
    path.write_bytes(content)
    return path


@given(content=st.binary(max_size=5000))
@settings(max_examples=20)
def test_bytes_come_back_under_their_digest(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    folder = tmp_path_factory.mktemp("store")
    store = ArtifactStore(folder / "artifacts")
    stored = store.put(written(folder, content))
    assert (stored.digest, stored.size) == (hashlib.sha256(content).hexdigest(), len(content))
    with store.open(stored.digest) as file:
        assert file.read() == content
    assert list(store.digests()) == [stored.digest]


def test_rotten_bytes_are_not_given_out_and_a_new_copy_heals_them(files: ArtifactStore, tmp_path: Path) -> None:
    stored = files.put(written(tmp_path, b"good"))
    place = files.place(stored.digest)
    place.chmod(0o644)
    place.write_bytes(b"evil")
    with pytest.raises(ArtifactDamaged):
        files.path(stored.digest)
    files.put(written(tmp_path, b"good"))
    assert files.path(stored.digest).read_bytes() == b"good"


def test_what_nobody_else_needs_is_moved_not_copied(files: ArtifactStore, tmp_path: Path) -> None:
    """Seen to fail: with `put` for `take` the file is another one; without its new age garbage would take it early."""
    source = written(tmp_path, b"large")
    os.utime(source, (0, 0))
    inode = source.stat().st_ino
    stored = stored_as(source)
    files.take(source, stored)
    place = files.path(stored.digest)
    assert not source.exists()
    assert (place.stat().st_ino, place.stat().st_mode & 0o777) == (inode, 0o444)
    assert not files.remove_older(stored.digest, 3600.0)


def test_what_a_link_points_to_stays_where_it_is(files: ArtifactStore, tmp_path: Path) -> None:
    source = written(tmp_path, b"another's")
    link = tmp_path / "link"
    link.symlink_to(source)
    stored = stored_as(link)
    files.take(link, stored)
    assert source.read_bytes() == b"another's"
    assert files.path(stored.digest).read_bytes() == b"another's"
    assert not files.place(stored.digest).is_symlink()


def test_interrupted_copy_leaves_nothing(files: ArtifactStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(artifacts.os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        files.put(written(tmp_path, b"bytes"))
    assert list(files.digests()) == []
    assert list((files.folder / artifacts.STAGING).iterdir()) == []


@pytest.mark.parametrize("digest", ["", "../../etc/passwd", "A" * 64, "0" * 63])
def test_what_is_no_digest_is_not_found(files: ArtifactStore, digest: str) -> None:
    with pytest.raises(NotFound):
        files.path(digest)


def test_missing_file_is_damage(files: ArtifactStore) -> None:
    with pytest.raises(ArtifactDamaged, match="missing"):
        files.path("0" * 64)


def test_stored_file_cannot_be_written_to_through_its_link(files: ArtifactStore, tmp_path: Path) -> None:
    stored = files.put(written(tmp_path, b"bytes"))
    place_input(files.path(stored.digest), tmp_path / "in" / "named.txt")
    assert (tmp_path / "in" / "named.txt").stat().st_mode & 0o222 == 0
