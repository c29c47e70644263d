"""The object store behind its cache, in obstore's own memory: the same laws as the folder, and what a cache adds."""

import os
import time
from pathlib import Path

import obstore
import pytest
from scanjobs.artifacts import ArtifactStore, stored_as
from scanjobs.errors import ArtifactDamaged
from scanjobs.object_store import IN_USE_S, ObjectArtifacts, open_artifacts
from scanjobs.settings import Settings


@pytest.fixture
def files(tmp_path: Path) -> ObjectArtifacts:
    """An empty store with room for ten bytes in its cache."""
    return ObjectArtifacts("memory:///", tmp_path / "cache", 10)


def store(files: ArtifactStore, content: str) -> str:
    """Store a file; its digest."""
    path = files.folder.parent / "file"
    path.write_text(content)
    return files.put(path).digest


def age(files: ArtifactStore, digest: str) -> None:
    """Let a cached file be one that nobody has used for long."""
    long_ago = time.time() - 2 * IN_USE_S
    os.utime(files.place(digest), (long_ago, long_ago))


def test_what_is_taken_is_uploaded_too(files: ObjectArtifacts, tmp_path: Path) -> None:
    source = tmp_path / "made"
    source.write_text("made")
    stored = stored_as(source)
    files.take(source, stored)
    digest = stored.digest
    assert files.holds(digest)
    files.place(digest).unlink()
    assert files.path(digest).read_text() == "made"


def test_what_is_not_cached_is_downloaded(files: ObjectArtifacts) -> None:
    digest = store(files, "bytes")
    files.place(digest).unlink()
    assert files.path(digest).read_text() == "bytes"
    assert list(files.digests()) == [digest]
    assert files.holds(digest)


def test_rotten_cache_is_healed_from_the_object(files: ObjectArtifacts) -> None:
    digest = store(files, "bytes")
    files.place(digest).chmod(0o644)
    files.place(digest).write_text("evil!")
    assert files.path(digest).read_text() == "bytes"


def test_rotten_object_is_never_given_out(files: ObjectArtifacts) -> None:
    digest = store(files, "bytes")
    files.place(digest).unlink()
    obstore.put(files._objects, files._key(digest), b"evil!")
    with pytest.raises(ArtifactDamaged, match="other bytes"):
        files.path(digest)


def test_missing_object_is_damage(files: ObjectArtifacts) -> None:
    with pytest.raises(ArtifactDamaged, match="missing"):
        files.path("0" * 64)
    assert not files.holds("0" * 64)


def test_cache_keeps_its_size_and_what_is_in_use(files: ObjectArtifacts) -> None:
    old, used = store(files, "eight by"), store(files, "eight bz")
    age(files, old)
    new = store(files, "eight ba")
    assert [files.place(digest).exists() for digest in (old, used, new)] == [False, True, True]
    assert files.path(old).read_text() == "eight by"


def test_only_old_objects_are_removed(files: ObjectArtifacts) -> None:
    digest = store(files, "bytes")
    assert not files.remove_older(digest, 60.0)
    assert files.remove_older(digest, -1.0)
    assert not files.holds(digest)
    assert not files.place(digest).exists()


def test_one_setting_chooses_the_store(tmp_path: Path) -> None:
    folder = open_artifacts(Settings(data_folder=tmp_path))
    objects = open_artifacts(Settings(data_folder=tmp_path, artifact_url="memory:///"))
    assert type(folder) is ArtifactStore
    assert type(objects) is ObjectArtifacts
