"""One loop over frames for both fields: `fit` frame 0, `fine_tune` every frame from its checkpoint, then look at it.

A checkpoint is arrays only. That of frame 0 also holds the still backgrounds; those of the frames hold what differs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.field import grid, grid_training
from nerfmodal.field.bricks import Bricks
from nerfmodal.field.views import Views, views_of
from nerfmodal.spec import ReconstructionSpec
from nerfmodal.types import Checkpoint, Frame

VOXELS_ALONG = 128
"""Voxels along the region's largest side, unless the voxel is given."""
Told = Callable[[int, int, str], None]
"""Called with (iterations done, of, what to say)."""
Look = Callable[[Int[np.ndarray, "rays 3"]], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Pixels (camera, row, column) to colours (rays, 3), opacities (rays,) and distances (rays,) in metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """The box to reconstruct (metres) and the height of the ground, where there is one."""

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]
    ground: float | None


def fit(
    scene: Scene, settings: ReconstructionSpec, first: Frame, held_out: Frame | None, seed: int, told: Told
) -> Checkpoint:
    """Train frame 0 from nothing to the checkpoint that every frame starts from.

    Raises
    ------
    TrainingDiverged
        When the loss is no number.
    """
    say = _teller(told, settings.iterations)
    if settings.field == "mlp":
        return _fit_mlp(scene, settings, first, held_out, seed, say)
    voxel = settings.voxel_m or float((scene.high - scene.low).max()) / VOXELS_ALONG
    schedule = _schedule(settings, settings.iterations)
    field, loss = grid_training.fit(first, scene.low, scene.high, voxel, scene.ground, schedule, seed, say)
    state = _grid_state(field) | {"backgrounds": grid_training.still_backgrounds(field, views_of(first))}
    checkpoint = Checkpoint(
        field="grid", frame_index=first.index, step=settings.iterations, parent=None, state=state, psnr=psnr(loss)
    )
    return checkpoint if held_out is None else _measured(checkpoint, held_out)


def fine_tune(
    settings: ReconstructionSpec, parent: Checkpoint, first: Frame, frame: Frame, seed: int, told: Told
) -> Checkpoint:
    """Train `frame` from the frame-0 checkpoint, independently of all other frames.

    Raises
    ------
    TrainingDiverged
        When the loss is no number.
    """
    count = settings.fine_tune_iterations
    say = _teller(told, count)
    own_seed = seed + 1 + frame.index  # errors of the frames must not be alike
    if parent.field == "mlp":
        state, loss = _tune_mlp(settings, parent, frame, own_seed, say)
    else:
        field, loss = grid_training.fine_tune(
            _grid_of(parent.state), parent.state["backgrounds"], first, frame, _schedule(settings, count), own_seed, say
        )
        state = _grid_state(field)
    return Checkpoint(
        field=parent.field,
        frame_index=frame.index,
        step=parent.step + count,
        parent=parent.frame_index,
        state=state,
        psnr=psnr(loss) if loss else parent.psnr,
        held_out_psnr=parent.held_out_psnr,
    )


def looker(checkpoint: Checkpoint, frame: Frame, level: float) -> Look:
    """How a trained field looks through the cameras of `frame`; distances are where the opacity passes `level`."""
    views = views_of(frame)
    if checkpoint.field == "mlp":
        field = _mlp_of(checkpoint.state)
        return lambda pixels: field.look(views, pixels, level)
    cells = _grid_of(checkpoint.state)

    def look(pixels: Int[np.ndarray, "rays 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        front, left, _, distance = grid.render(cells, views, pixels, behind=False, level=level)
        opacity = 1.0 - left
        return front / np.maximum(opacity, 1e-6)[:, None], opacity, distance

    return look


def psnr(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio, dB, of colours in [0, 1]."""
    return float(-10.0 * np.log10(max(mean_squared_error, 1e-12)))


def _teller(told: Told, total: int) -> grid.Told:
    def tell(done: int, loss: float) -> None:
        told(done, total, f"PSNR {psnr(loss):.1f} dB")

    return tell


def _schedule(settings: ReconstructionSpec, iterations: int) -> grid_training.Schedule:
    rates = grid.Rates() if settings.learning_rate is None else grid.Rates(density=settings.learning_rate)
    return grid_training.Schedule(iterations=iterations, rays=settings.rays_per_batch, rates=rates)


def _measured(checkpoint: Checkpoint, held_out: Frame) -> Checkpoint:
    """The checkpoint with its PSNR on views that it was not trained on."""
    views = views_of(held_out)
    pixels = np.stack(np.unravel_index(np.arange(views.pixels), views.images.shape[:3]), axis=1).astype(np.int32)
    truth = views.images.reshape(-1, 3) / 255.0
    error = float(np.mean((_picture(checkpoint, views, pixels) - truth) ** 2))
    return replace(checkpoint, held_out_psnr=psnr(error))


def _picture(checkpoint: Checkpoint, views: Views, pixels: Int[np.ndarray, "rays 3"]) -> Float[np.ndarray, "rays 3"]:
    if checkpoint.field == "mlp":
        return _mlp_of(checkpoint.state).look(views, pixels)[0]
    front, left, behind, _ = grid.render(_grid_of(checkpoint.state), views, pixels, behind=True)
    return np.clip(front + left[:, None] * behind, 0.0, 1.0)


def _grid_state(field: grid.GridField) -> dict[str, np.ndarray]:
    return {
        "low": field.bricks.low,
        "high": field.high,
        "voxel": np.array([field.bricks.voxel, field.ground]),
        "sides": np.array(field.sides),
        "slots": field.bricks.slots,
        "masks": field.bricks.masks,
        "outer": field.outer,
        "values": field.values,
    }


def _grid_of(state: Mapping[str, np.ndarray]) -> grid.GridField:
    voxel, ground = (float(value) for value in state["voxel"])
    bricks = Bricks(low=state["low"], voxel=voxel, slots=state["slots"], masks=state["masks"])
    return grid.GridField(
        bricks=bricks,
        high=state["high"],
        values=state["values"],
        outer=state["outer"],
        ground=ground,
        sides=(int(state["sides"][0]), int(state["sides"][1])),
    )


def _fit_mlp(
    scene: Scene, settings: ReconstructionSpec, first: Frame, held_out: Frame | None, seed: int, say: grid.Told
) -> Checkpoint:
    from nerfmodal.field.mlp import MlpField

    field = MlpField(scene.low, scene.high, _mlp_settings(settings), seed)
    loss = field.train(views_of(first), settings.iterations, seed, say)
    checkpoint = Checkpoint(
        field="mlp",
        frame_index=first.index,
        step=settings.iterations,
        parent=None,
        state=field.state(),
        psnr=psnr(loss),
    )
    return checkpoint if held_out is None else _measured(checkpoint, held_out)


def _tune_mlp(
    settings: ReconstructionSpec, parent: Checkpoint, frame: Frame, seed: int, say: grid.Told
) -> tuple[dict[str, np.ndarray], float]:
    field = _mlp_of(parent.state)
    loss = field.train(views_of(frame), settings.fine_tune_iterations, seed, say)
    return field.state(), loss


def _mlp_settings(settings: ReconstructionSpec):  # type: ignore[no-untyped-def]
    from nerfmodal.field.mlp import MlpSettings

    return MlpSettings(
        width=settings.mlp_width,
        coarse_samples=settings.coarse_samples,
        fine_samples=settings.fine_samples,
        learning_rate=settings.learning_rate or MlpSettings().learning_rate,
        rays_per_batch=settings.rays_per_batch,
    )


def _mlp_of(state: Mapping[str, np.ndarray]):  # type: ignore[no-untyped-def]
    from nerfmodal.field.mlp import MlpField

    return MlpField.of(state)
