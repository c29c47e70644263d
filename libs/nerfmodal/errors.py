"""The exceptions of the science.

::

    NerfmodalError
     ├─ InvalidInput            what was given cannot be used; exit code 3, HTTP 422
     │   ├─ InvalidSpec         a key of the scan specification
     │   ├─ InvalidCapture      a picture, a pose or a file of a capture
     │   └─ InvalidClouds       a point cloud or its clouds.json
     ├─ MissingExtra            an optional wheel is not installed
     └─ TrainingDiverged        the field's loss is no longer a number

A poor but usable numerical result is no exception: it is an `Outcome` (see `types`).
"""

from typing import ClassVar


class NerfmodalError(Exception):
    """Something went wrong; `where` names the field or file and `hint` what to change."""

    code: ClassVar[str] = "ERROR"

    def __init__(self, message: str, *, where: str | None = None, hint: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.hint = hint

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        remedy = f" {self.hint}" if self.hint else ""
        return f"{place}{self.message}{remedy}"


class InvalidInput(NerfmodalError):
    """The input cannot be used as it is; correct what `where` names."""

    code = "INVALID_INPUT"


class InvalidSpec(InvalidInput):
    """A key of the scan specification has a value that cannot be; `where` is its JSON pointer."""

    code = "INVALID_SPEC"


class InvalidCapture(InvalidInput):
    """A file of the capture is missing, broken or contradicts another; `where` is its path."""

    code = "INVALID_CAPTURE"


class InvalidClouds(InvalidInput):
    """A point cloud is missing, broken or contradicts its clouds.json; `where` is its path."""

    code = "INVALID_CLOUDS"


class MissingExtra(NerfmodalError):
    """An optional wheel is not installed; `hint` is the pip command that installs it."""

    code = "MISSING_EXTRA"

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"the package '{package}' is not installed.",
            hint=f"Install it with: pip install 'nerfmodal[{extra}]'",
        )


class TrainingDiverged(NerfmodalError):
    """The loss is no longer finite; lower `reconstruction.learning_rate` or check the pictures."""

    code = "TRAINING_DIVERGED"
