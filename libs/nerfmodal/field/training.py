"""One way to train both fields: `fit` frame 0, `fine_tune` every frame from its checkpoint, then look at it.

A checkpoint is arrays only. That of frame 0 also holds the still backgrounds; those of the frames hold what differs.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.field import grid, grid_training
from nerfmodal.field.backgrounds import still_backgrounds
from nerfmodal.field.beyond import Ground
from nerfmodal.field.course import Course, Told, psnr
from nerfmodal.field.device import described
from nerfmodal.field.views import Views, views_of
from nerfmodal.io.resume import ResumeFile
from nerfmodal.spec import ReconstructionSpec
from nerfmodal.types import Checkpoint, Frame, Look

VOXELS_ALONG = 192
"""Voxels along the region's largest side, unless the voxel is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """The box to reconstruct (metres) and the ground, where there is one."""

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]
    ground: Ground | None


def voxel_of(scene: Scene, settings: ReconstructionSpec) -> float:
    """Side of the finest voxel, metres; what resolution is expected of either field."""
    return settings.voxel_m or float((scene.high - scene.low).max()) / VOXELS_ALONG


def fit(
    scene: Scene,
    settings: ReconstructionSpec,
    first: Frame,
    held_out: Frame | None,
    seed: int,
    told: Told,
    resume: ResumeFile | None = None,
    alone: bool = False,
) -> Checkpoint:
    """Train frame 0 from nothing to the checkpoint that every frame starts from.

    A frame that is `alone` has no further ones, which would need what stands still behind the structure.
    `resume` takes up a training that was stopped, and is given states from time to time.

    Raises
    ------
    TrainingDiverged
        When the loss is no number, or becomes much worse than it was.
    """
    course = Course(settings.iterations, told)
    keeping = resume or ResumeFile(None)
    if settings.field == "mlp":
        from nerfmodal.field import mlp_training

        state = mlp_training.fit(settings, scene.low, scene.high, first, seed, course, keeping)
    else:
        voxel = voxel_of(scene, settings)
        schedule = _schedule(settings, settings.iterations)
        field = grid_training.fit(first, scene.low, scene.high, voxel, scene.ground, schedule, seed, course, keeping)
        state = grid.grid_state(field)
        if not alone:
            behind = still_backgrounds(field, first)
            state |= {"backgrounds": behind.images, "backgrounds_known": behind.known}
    checkpoint = Checkpoint(
        field=settings.field,
        frame_index=first.index,
        step=course.done,
        parent=None,
        state=state,
        psnr=psnr(course.loss),
        device=", ".join(described()),
    )
    return checkpoint if held_out is None else _measured(checkpoint, held_out)


def fine_tune(
    settings: ReconstructionSpec,
    parent: Checkpoint,
    first: Frame,
    frame: Frame,
    seed: int,
    told: Told,
    resume: ResumeFile | None = None,
) -> Checkpoint:
    """Train `frame` from the frame-0 checkpoint, independently of all other frames; ends early where it has settled.

    Raises
    ------
    TrainingDiverged
        When the loss is no number, or becomes much worse than it was.
    """
    course = Course(settings.fine_tune_iterations, told)
    keeping = resume or ResumeFile(None)
    own_seed = seed + 1 + frame.index  # errors of the frames must not be alike
    if parent.field == "mlp":
        from nerfmodal.field import mlp_training

        state = mlp_training.fine_tune(settings, parent.state, first, frame, own_seed, course, keeping)
    else:
        schedule = _schedule(settings, settings.fine_tune_iterations)
        field = grid_training.fine_tune(
            grid.grid_of(parent.state), parent.state.get("backgrounds"), first, frame, schedule, own_seed, course
        )
        state = grid.grid_state(field)
    return Checkpoint(
        field=parent.field,
        frame_index=frame.index,
        step=parent.step + course.done,
        parent=parent.frame_index,
        state=state,
        psnr=psnr(course.loss) if course.done else parent.psnr,
        held_out_psnr=parent.held_out_psnr,
        device=", ".join(described()),
    )


def looker(checkpoint: Checkpoint, frame: Frame) -> Look:
    """How a trained field looks through the cameras of `frame`.

    A ray's distance is the median of its weights (eq 8); the spread, between their quartiles, says how sure it is.
    """
    views = views_of(frame)
    if checkpoint.field == "mlp":
        from nerfmodal.field.mlp import MlpField

        network = MlpField.of(checkpoint.state)
        return lambda pixels: network.look(views, pixels)
    cells = grid.grid_of(checkpoint.state)

    def look(pixels: Int[np.ndarray, "rays 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        front, left, _, distance, spread = grid.render(cells, views, pixels, behind=False)
        opacity = 1.0 - left
        return front / np.maximum(opacity, 1e-6)[:, None], opacity, distance, spread

    return look


def _schedule(settings: ReconstructionSpec, iterations: int) -> grid_training.Schedule:
    rates = grid.Rates() if settings.learning_rate is None else grid.Rates(density=settings.learning_rate)
    return grid_training.Schedule(iterations=iterations, rays=settings.rays_per_batch, rates=rates)


def _measured(checkpoint: Checkpoint, held_out: Frame) -> Checkpoint:
    """The checkpoint with its PSNR on views that it was not trained on."""
    views = views_of(held_out)
    show = _picture(checkpoint, views)
    errors = [
        np.mean((show(views.pixels_of(camera)) - image.reshape(-1, 3) / np.float32(255)) ** 2)
        for camera, image in enumerate(views.images)
    ]
    return replace(checkpoint, held_out_psnr=psnr(float(np.mean(errors))))


def _picture(
    checkpoint: Checkpoint, views: Views
) -> Callable[[Int[np.ndarray, "rays 3"]], Float[np.ndarray, "rays 3"]]:
    if checkpoint.field == "mlp":
        from nerfmodal.field.mlp import MlpField

        network = MlpField.of(checkpoint.state)
        return lambda pixels: network.look(views, pixels)[0]
    field = grid.grid_of(checkpoint.state)

    def show(pixels: Int[np.ndarray, "rays 3"]) -> Float[np.ndarray, "rays 3"]:
        front, left, behind, _, _ = grid.render(field, views, pixels, behind=True)
        return np.clip(front + left[:, None] * behind, 0.0, 1.0)

    return show
