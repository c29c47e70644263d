"""One function per stage, and `run`: the whole scan in one process, with no service.

Each stage takes values and returns values; the worker's tasks load, call one of these, and save.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nerfmodal.spec import ScanSpec
from nerfmodal.types import Checkpoint, Frame, PointCloud, ScanResult


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far a stage is: `done` of `total` units, and what it would say of itself (loss, PSNR, rays/s)."""

    done: int
    total: int
    message: str = ""


Report = Callable[[Progress], None]
"""Called often by long stages; whatever it raises stops the stage (this is how a scan is cancelled)."""


def frame_times(spec: ScanSpec) -> tuple[float, ...]:
    """Instants in seconds of the frames of a simulation or capture; clouds know their own.

    Reads only the capture's transforms.json. Raises `InvalidCapture`.
    """
    raise NotImplementedError


def check_source(spec: ScanSpec) -> None:
    """Refuse, before anything runs, a capture or clouds that cannot be used.

    Raises `InvalidCapture` or `InvalidClouds`, naming the file, or `MissingExtra`.
    """
    raise NotImplementedError


def make_frame(spec: ScanSpec, index: int, *, report: Report) -> Frame:
    """Frame `index`: rendered (simulation) or read (capture)."""
    raise NotImplementedError


def fit_first(spec: ScanSpec, first: Frame, *, report: Report) -> Checkpoint:
    """Train frame 0 from nothing to the checkpoint that every frame starts from."""
    raise NotImplementedError


def fine_tune(spec: ScanSpec, parent: Checkpoint, first: Frame, frame: Frame, *, report: Report) -> Checkpoint:
    """Train `frame` from the frame-0 checkpoint; independent of all other frames (frame 0 included)."""
    raise NotImplementedError


def extract(spec: ScanSpec, checkpoint: Checkpoint, frame: Frame, *, report: Report) -> PointCloud:
    """The point cloud of a trained frame (eq 10). Always ends; see its `outcome`."""
    raise NotImplementedError


def read_clouds(spec: ScanSpec) -> Iterator[PointCloud]:
    """The clouds of a `clouds` source, in time order. Raises `InvalidClouds`."""
    raise NotImplementedError


def identify(spec: ScanSpec, clouds: Sequence[PointCloud | None], *, report: Report) -> ScanResult:
    """Modes of every organ from the clouds; None is a frame that was lost. Never reads the truth."""
    raise NotImplementedError


def write_truth(spec: ScanSpec, path: Path) -> None:
    """What a simulation imposed, as `truth.npz` (`io.read_truth`); only comparison code opens it."""
    raise NotImplementedError


def publish(
    spec: ScanSpec, result: ScanResult, frame: Frame | None, cloud: PointCloud | None, out: Path
) -> tuple[Path, ...]:
    """Write everything a user downloads under `out` (result.npz, modes.json, report.html, pictures …).

    `frame` and `cloud` are the first ones, for the report's pictures. Returns the files written.
    """
    raise NotImplementedError


def run(spec: ScanSpec, out: Path, *, report: Callable[[str, Progress], None]) -> ScanResult:
    """The whole scan in this process; writes the results under `out`."""
    raise NotImplementedError
