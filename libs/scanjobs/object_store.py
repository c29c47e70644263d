"""Artifacts in an object store (S3, GCS, Azure), with a folder of this machine as a cache.

The object of a digest is `PREFIX/ab/abcdef…`. A put is atomic: an object is there with all its bytes or not at all.
Credentials and endpoint come from the environment that the store's own tools read (`AWS_ACCESS_KEY_ID`,
`AWS_ENDPOINT_URL` …). What is read is verified on its way into the cache, and again on every way out of it.
"""

import os
import secrets
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, Final

from scanjobs.artifacts import STAGING, ArtifactStore, Stored
from scanjobs.errors import ArtifactDamaged
from scanjobs.settings import Settings

IN_USE_S: Final = 600.0
"""A cached file used less than this long ago is not evicted: somebody may be about to open it."""
BLOCK: Final = 8 << 20


def open_artifacts(settings: Settings) -> ArtifactStore:
    """The artifact store that the settings name: `artifact_url`, or a folder."""
    if settings.artifact_url is None:
        return ArtifactStore(settings.artifacts)
    return ObjectArtifacts(settings.artifact_url, settings.artifacts, settings.artifact_cache_mb * 10**6)


class ObjectArtifacts(ArtifactStore):
    """An object store behind a cache folder.

    Parameters
    ----------
    url
        For instance `s3://bucket/prefix`.
    folder
        The cache.
    cache_bytes
        How large the cache may grow before what was not used for long is evicted.
    """

    is_near: ClassVar[bool] = False

    def __init__(self, url: str, folder: Path, cache_bytes: int) -> None:
        super().__init__(folder)
        self._cache_bytes = cache_bytes
        self._objects = _connect(url)

    def put(self, source: Path) -> Stored:
        """Upload a file; it is stored when this returns."""
        return self._upload(super().put(source))

    def take(self, source: Path, stored: Stored) -> None:
        """Upload a file that nobody else needs and `stored_as` knows."""
        super().take(source, stored)
        self._upload(stored)

    def path(self, digest: str) -> Path:
        """The verified file of a digest, downloaded if need be. Raises `ArtifactDamaged` or `NotFound`."""
        place = self.place(digest)
        if place.is_file():
            try:
                os.utime(place)
                return super().path(digest)
            except ArtifactDamaged:
                place.unlink(missing_ok=True)  # the cache has rotted, the object may be whole
        self._download(digest)
        return super().path(digest)

    def holds(self, digest: str) -> bool:
        """Whether the object is there."""
        return self._written_at(digest) is not None

    def remove_older(self, digest: str, age_s: float) -> bool:
        """Remove an object that was written longer ago than `age_s`.

        Between the look and the removal the same bytes might be written anew; an object store has no way to exclude
        it. The window is some milliseconds a day after the first writing, and a reader would be told of it.
        """
        import obstore

        written_at = self._written_at(digest)
        if written_at is None or datetime.now(UTC).timestamp() - written_at <= age_s:
            return False
        obstore.delete(self._objects, self._key(digest))
        self.place(digest).unlink(missing_ok=True)
        return True

    def digests(self) -> Iterator[str]:
        """Every digest stored, in no order."""
        import obstore

        for batch in obstore.list(self._objects):
            for one in batch:
                yield one["path"].rpartition("/")[2]

    def _key(self, digest: str) -> str:
        return f"{digest[:2]}/{digest}"

    def _written_at(self, digest: str) -> float | None:
        import obstore

        try:
            return float(obstore.head(self._objects, self._key(digest))["last_modified"].timestamp())
        except FileNotFoundError:
            return None

    def _upload(self, stored: Stored) -> Stored:
        import obstore  # here: an extra

        obstore.put(self._objects, self._key(stored.digest), self.place(stored.digest))
        self._evict()
        return stored

    def _download(self, digest: str) -> None:
        import obstore

        staged = self.folder / STAGING / secrets.token_hex(16)
        try:
            with staged.open("xb") as file:
                for block in obstore.get(self._objects, self._key(digest)).stream(min_chunk_size=BLOCK):
                    file.write(block)
            staged.chmod(0o444)
            self._publish(staged, digest)
        except FileNotFoundError as error:
            raise ArtifactDamaged(digest, "is missing") from error
        finally:
            staged.unlink(missing_ok=True)
        self._evict()

    def _evict(self) -> None:
        """Bring the cache back to its size, oldest use first."""
        files = [(path.stat(), path) for path in self.folder.glob("[0-9a-f][0-9a-f]/*")]
        excess = sum(facts.st_size for facts, _ in files) - self._cache_bytes
        for facts, path in sorted(files, key=lambda one: one[0].st_mtime):
            if excess <= 0 or time.time() - facts.st_mtime < IN_USE_S:
                return
            path.unlink(missing_ok=True)
            excess -= facts.st_size


def _connect(url: str) -> Any:
    from obstore.store import from_url

    endpoint = os.environ.get("AWS_ENDPOINT_URL", "")
    return from_url(url, client_options={"allow_http": endpoint.startswith("http://")})
