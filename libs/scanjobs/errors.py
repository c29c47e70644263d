"""The exceptions of the jobs.

::

    ScanjobsError
     ├─ NotFound                no such scan, step or artifact; HTTP 404
     ├─ IllegalTransition       the state does not allow it; HTTP 409
     ├─ IdempotencyConflict     the key was used with another body; HTTP 409
     ├─ InvalidCursor           the cursor was not made by this service; HTTP 422
     ├─ QuotaExceeded           the owner's room, or the disk's, is used up; HTTP 507
     ├─ TooLarge                a file is larger than the service takes; HTTP 413
     ├─ UploadConflict          the bytes do not continue what has arrived; HTTP 409
     ├─ UploadBusy              another request is sending to the same upload; HTTP 423
     ├─ SourceOutsideRoots      a path that the service may not read; HTTP 422
     ├─ ArtifactDamaged         the stored bytes no longer have their digest
     ├─ DataFolderInUse         a second server on one data folder
     └─ DatabaseOutOfDate       its tables are not those of this version
"""

from typing import ClassVar


class ScanjobsError(Exception):
    """A job cannot do what was asked; `where` is the JSON pointer of the field, `hint` what to change."""

    code: ClassVar[str] = "ERROR"

    def __init__(self, message: str, *, where: str | None = None, hint: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.hint = hint


class NotFound(ScanjobsError):
    """Nothing has this id, or it belongs to somebody else; list what there is and use one of those ids."""

    code = "NOT_FOUND"


class IllegalTransition(ScanjobsError):
    """The present state does not allow this; wait for another state or ask for something else."""

    code = "ILLEGAL_TRANSITION"


class IdempotencyConflict(ScanjobsError):
    """This Idempotency-Key came with another body before; use a new key for a new request."""

    code = "IDEMPOTENCY_CONFLICT"


class InvalidCursor(ScanjobsError):
    """The cursor cannot be read; start again without one."""

    code = "INVALID_CURSOR"


class QuotaExceeded(ScanjobsError):
    """There is no room for this: delete uploads, captures or scans, or ask the operator for more."""

    code = "QUOTA_EXCEEDED"


class TooLarge(ScanjobsError):
    """The file is larger than this service takes; send less, or ask the operator to raise the limit."""

    code = "TOO_LARGE"


class UploadConflict(ScanjobsError):
    """The bytes do not continue what has arrived; ask how far the upload is and go on from there."""

    code = "UPLOAD_CONFLICT"


class UploadBusy(ScanjobsError):
    """Another request is sending to the same upload; wait until it has ended."""

    code = "UPLOAD_BUSY"


class SourceOutsideRoots(ScanjobsError):
    """The path leads out of the folders that captures may lie in, or to nothing; put the capture in one of them."""

    code = "SOURCE_OUTSIDE_ROOTS"


class ArtifactDamaged(ScanjobsError):
    """A stored file is missing or no longer has its digest; retry the scan from the step that made it."""

    code = "ARTIFACT_DAMAGED"

    def __init__(self, digest: str, reason: str) -> None:
        super().__init__(
            f"the stored file of {digest} {reason}.", hint="Retry the scan: the step that made it is computed again."
        )
        self.digest = digest


class DataFolderInUse(ScanjobsError):
    """Another server runs on this data folder; stop it or choose another folder."""

    code = "DATA_FOLDER_IN_USE"


class DatabaseOutOfDate(ScanjobsError):
    """The database's tables are not those of this version; run `nerfmodal migrate` with the same settings."""

    code = "DATABASE_OUT_OF_DATE"
