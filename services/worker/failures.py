"""Why an attempt failed, told by the machine, by the runner, or by the runner's silence."""

from typing import Final

from scanjobs.claims import Failure
from scanjobs.disk import is_full

from services.worker.child import Child
from services.worker.protocol import DISK_FULL, Failed, Line, failed_line

TOO_LONG: Final = Failed(
    code="STEP_TOO_LONG",
    message="the step computed for longer than it may.",
    hint="Raise NERFMODAL_STEP_LIMIT_S, or ask for less.",
)
MAYBE_MEMORY: Final = "It may have run out of memory: use fewer slots, points or pixels."


def of_system(error: OSError) -> Failure:
    """Why this machine could not do its part; a full disk is no attempt of the step."""
    if is_full(error):
        hint = "Free some space; the scan then goes on by itself."
        return Failure(code=DISK_FULL, message="the disk is full.", hint=hint, counted=False)
    return Failure(code="INTERNAL", message=f"{type(error).__name__}: {error}", hint="The worker's log has more.")


def of_runner(failed: Failed, exit_code: int | None) -> Failure:
    """Why the runner could not compute the step."""
    return Failure(
        code=failed.code,
        message=failed.message,
        hint=failed.hint,
        retryable=failed.retryable,
        counted=failed.code != DISK_FULL,
        exit_code=exit_code,
    )


def death_of(child: Child) -> Line:
    """The runner ended without a word."""
    child.kill()
    code = child.exit_code
    message = f"the process that computed the step ended with code {code}."
    return failed_line(Failed(code="RUNNER_DIED", message=message, hint=MAYBE_MEMORY if code == -9 else None))
