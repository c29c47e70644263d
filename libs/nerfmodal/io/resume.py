"""The state of an unfinished training, so that it goes on where it was stopped instead of from the beginning.

Arrays in one safetensors file, replaced as a whole; a file of another training, or a broken one, is as good as none.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from nerfmodal.io.atomic import atomic_write

KEEP_EVERY_S = 30.0
"""At most so much work is lost."""


def _stay(path: Path) -> None:
    """Leave the file where it is."""
    del path


class ResumeFile:
    """Where one training keeps its state.

    Parameters
    ----------
    path
        The file to keep it in; None keeps nothing.
    start
        The file that an earlier attempt kept, by default `path`.
    kept
        Told the path whenever a state has been kept; may take the file away.
    every_s
        Seconds between two states at the least.
    """

    def __init__(
        self,
        path: Path | None,
        *,
        start: Path | None = None,
        kept: Callable[[Path], None] = _stay,
        every_s: float = KEEP_EVERY_S,
    ) -> None:
        self._path = path
        self._start = start or path
        self._told = kept
        self._every = every_s
        self._last = monotonic()
        self.training = ""
        """What this training is (its specification and frame): the state of any other is not taken up."""

    def taken_up(self) -> dict[str, np.ndarray] | None:
        """The state that was kept last, or None where the training begins."""
        if self._start is None or not self._start.exists():
            return None
        try:
            with safe_open(self._start, framework="numpy") as archive:
                if (archive.metadata() or {}).get("training") != self.training:
                    return None
                return {name: archive.get_tensor(name) for name in archive.keys()}  # noqa: SIM118 (no mapping)
        except (OSError, SafetensorError):
            return None

    @property
    def is_due(self) -> bool:
        """Whether it is time to keep a state: gathering one costs a copy of everything."""
        return self._path is not None and monotonic() - self._last >= self._every

    def keep(self, state: Mapping[str, np.ndarray]) -> None:
        """Replace what was kept by `state`, at once and as a whole."""
        if self._path is None:
            return
        with atomic_write(self._path) as temporary:
            save_file(dict(state), temporary, metadata={"training": self.training})
        self._last = monotonic()
        self._told(self._path)

    def forget(self) -> None:
        """Remove what was kept: the training is done."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
