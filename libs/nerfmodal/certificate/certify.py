"""`certify`: film the board with a rig, reconstruct and identify it as any scan, and hold it against what was imposed.

Pictures are ray-cast (`simulate.preview`), with the noise of a sensor added in 8-bit counts; everything after them is
the pipeline of a real scan.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from nerfmodal import pipeline
from nerfmodal.certificate.document import Document, certificate_document
from nerfmodal.certificate.target import Board, board_before, moved, true_modes
from nerfmodal.errors import InvalidInput
from nerfmodal.geometry.cameras import downscale
from nerfmodal.identify.comparison import compare
from nerfmodal.progress import Progress
from nerfmodal.simulate import preview
from nerfmodal.spec import OrganSpec, ReconstructionSpec, ScanSpec, SimulationSource
from nerfmodal.types import Camera, Frame, PointCloud, Rig, TrueMode

FEWEST_CAMERAS, FEWEST_FRAMES = 3, 32
SENSORS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How a rig is tried.

    `longest_px` shrinks larger pictures by a whole number first, as the time goes with their size; `noise_counts` is
    the standard deviation of a pixel's noise in 8-bit counts.
    """

    frame_rate: float
    frames: int = 48
    longest_px: int = 320
    noise_counts: float = 1.0
    samples: int = 2
    iterations: int = 500
    fine_tune_iterations: int = 160
    voxels: int = 160
    seed: int = 0


def certify(rig: Rig, settings: Settings, *, report: Callable[[str, Progress], None]) -> Document:
    """The certificate of a rig (see `document`).

    Raises
    ------
    InvalidInput
        Fewer than three cameras or 32 frames.
    MissingExtra
        Without open3d.
    """
    _refuse(rig, settings)
    smaller = Rig(cameras=tuple(_shrunk(camera, settings.longest_px) for camera in rig.cameras))
    rng = np.random.default_rng(settings.seed)
    board = board_before(smaller, rng, settings.voxels)
    spec = _spec(board, settings)
    times = np.array(pipeline.frame_times(spec))
    modes = true_modes(board, settings.frame_rate, times)
    frames = (_film(board, modes, index, times, settings, report) for index in range(settings.frames))
    clouds = list(_reconstruct(spec, frames, settings.frames, report))
    result = pipeline.identify(spec, clouds, report=lambda now: report("identify", now))
    return certificate_document(rig, board, settings, compare(result, modes), modes)


def _refuse(rig: Rig, settings: Settings) -> None:
    if len(rig.cameras) < FEWEST_CAMERAS:
        raise InvalidInput(
            f"has {len(rig.cameras)} cameras.", where="rig", hint=f"Use {FEWEST_CAMERAS} or more; 12 see all around."
        )
    if settings.frames < FEWEST_FRAMES:
        raise InvalidInput(
            f"are {settings.frames}, too few to tell modes apart.",
            where="frames",
            hint=f"Film {FEWEST_FRAMES} or more.",
        )


def _shrunk(camera: Camera, longest: int) -> Camera:
    return downscale(camera, -(-max(camera.width, camera.height) // longest))


def _spec(board: Board, settings: Settings) -> ScanSpec:
    """The scan that the board is: frames that are handed in, organs at known places."""
    source = SimulationSource(
        kind="simulation", frames=settings.frames, frame_rate_hz=settings.frame_rate, motion=(), renderer="preview"
    )
    reconstruction = ReconstructionSpec(
        region=board.region,
        voxel_m=board.grain,
        iterations=settings.iterations,
        fine_tune_iterations=settings.fine_tune_iterations,
        points=30_000,
    )
    organs = tuple(
        OrganSpec(name=name, region=box, sensors=SENSORS)
        for name, box in zip(board.mesh.organs, board.regions, strict=True)
    )
    return ScanSpec(name="certificate", source=source, reconstruction=reconstruction, organs=organs, seed=settings.seed)


def _film(
    board: Board,
    modes: tuple[TrueMode, ...],
    index: int,
    times: np.ndarray,
    settings: Settings,
    report: Callable[[str, Progress], None],
) -> Frame:
    """Frame `index`: every view, ray-cast and with the sensor's noise."""
    vertices = moved(board, modes, index)
    with preview.open_studio(board.mesh, vertices, settings.seed) as studio:
        views = np.stack([studio.shoot(camera, settings.samples) for camera in board.rig.cameras])
    report("film", Progress(done=index + 1, total=settings.frames))
    rng = np.random.default_rng([settings.seed, index])
    return Frame(index=index, time=float(times[index]), images=_noisy(views, settings.noise_counts, rng), rig=board.rig)


def _noisy(
    views: UInt8[np.ndarray, "cameras height width 3"], counts: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "cameras height width 3"]:
    noise = counts * rng.standard_normal(views.shape, dtype=np.float32)
    return np.clip(np.round(views + noise), 0, 255).astype(np.uint8)


def _reconstruct(
    spec: ScanSpec, frames: Iterator[Frame], count: int, report: Callable[[str, Progress], None]
) -> Iterator[PointCloud]:
    first = next(frames)
    parent = pipeline.fit_first(spec, first, report=lambda now: report("train first", now))
    frame: Frame | None = first
    done = 0
    while frame is not None:
        tuned = pipeline.fine_tune(spec, parent, first, frame, report=lambda _: None)
        cloud = pipeline.extract(spec, tuned, frame, report=lambda _: None)
        done += 1
        report("reconstruct", Progress(done=done, total=count))
        yield cloud
        frame = next(frames, None)
