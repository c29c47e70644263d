"""How a command ends: 0 done, 1 failed, 2 wrong usage, 3 invalid input; and what a person or a machine reads of it."""

import errno
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import typer
from nerfmodal.errors import InvalidInput, NerfmodalError
from scanjobs.errors import ScanjobsError
from typer.core import TyperGroup

from services.api.complaints import Complaint
from services.cli.output import wants_json

FULL = (errno.ENOSPC, errno.EDQUOT)
FAILED = 1
USAGE = 2
INVALID = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """An exit code, a stable word for it, and what is wrong."""

    exit_code: int
    code: str
    complaints: tuple[Complaint, ...]


class SpecRefused(InvalidInput):
    """A specification has several faults; each names its key, its line and its remedy."""

    code = "INVALID_SPEC"

    def __init__(self, complaints: Sequence[Complaint]) -> None:
        super().__init__(complaints[0].message, where=complaints[0].pointer, hint=complaints[0].hint)
        self.complaints = tuple(complaints)


class Commands(TyperGroup):
    """The root command: what a command raises becomes a message on standard error and an exit code."""

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        try:
            return super().invoke(ctx)
        except Exception as error:
            ending = ending_of(error)
            if ending is None:
                raise
            tell(ending, as_json=wants_json(ctx))
            raise typer.Exit(ending.exit_code) from error


def ending_of(error: Exception) -> Ending | None:
    """The ending that an exception means; None for one that nobody foresaw."""
    if isinstance(error, SpecRefused):
        return Ending(exit_code=INVALID, code=error.code, complaints=error.complaints)
    if isinstance(error, NerfmodalError | ScanjobsError):
        code = INVALID if isinstance(error, InvalidInput) else FAILED
        complaint = Complaint(pointer=error.where or "", message=error.message, hint=error.hint or "")
        return Ending(exit_code=code, code=error.code, complaints=(complaint,))
    if isinstance(error, OSError) and error.errno in FULL:
        return _disk_full(error)
    return _ending_of_service(error)


def _disk_full(error: OSError) -> Ending:
    """What was being written is gone, as files are whole or absent; all that was finished before is there."""
    hint = "Make room, or give another folder with --out, and run the command again."
    complaint = Complaint(pointer=str(error.filename or ""), message="the disk is full.", hint=hint)
    return Ending(exit_code=FAILED, code="DISK_FULL", complaints=(complaint,))


def tell(ending: Ending, *, as_json: bool) -> None:
    """Write what is wrong to standard error."""
    if as_json:
        rows = [asdict(complaint) for complaint in ending.complaints]
        sys.stderr.write(json.dumps({"code": ending.code, "errors": rows}, ensure_ascii=False) + "\n")
        return
    for complaint in ending.complaints:
        place = f"{complaint.pointer}: " if complaint.pointer else ""
        sys.stderr.write(f"{place}{complaint.message}\n")
        if complaint.hint:
            sys.stderr.write(f"  {complaint.hint}\n")


def _ending_of_service(error: Exception) -> Ending | None:
    from scanclient.errors import InvalidRequest, Problem, ScanClientError  # here: httpx takes long to import

    if not isinstance(error, ScanClientError):
        return None
    if isinstance(error, Problem):
        complaint = Complaint(pointer=error.pointer or "", message=error.detail, hint=error.hint or "")
        code = INVALID if isinstance(error, InvalidRequest) else FAILED
        return Ending(exit_code=code, code=error.code, complaints=(complaint,))
    name = type(error).__name__
    return Ending(exit_code=FAILED, code=name, complaints=(Complaint(pointer="", message=str(error), hint=""),))
