"""How the paper's networks are trained: Adam on batches of random rays (eq 9), resumable to the bit on a CPU.

The rate falls tenfold over the training. On a GPU the products are taken in half precision, with scaled gradients.
"""

import json
from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from nerfmodal.errors import TrainingDiverged
from nerfmodal.field.changes import changed_pixels
from nerfmodal.field.course import Course, Settling
from nerfmodal.field.mlp import MlpField, MlpSettings
from nerfmodal.field.views import Views, pixels_at, views_of
from nerfmodal.io.resume import ResumeFile
from nerfmodal.spec import ReconstructionSpec
from nerfmodal.types import Frame

FALL = 0.1
"""The last learning rate as a share of the first."""
SETTLED = 1e-4
"""Movement of the surface between two looks that counts as none, as a share of the region's largest side."""
WATCHED = 1024
"""Rays through changed pixels whose surface is watched."""
LOOKS = 20
"""How often the surface is looked at over a training, to see whether it has settled."""


def squared_error(
    coarse: Float[Tensor, "rays 3"], fine: Float[Tensor, "rays 3"], truth: Float[Tensor, "rays 3"]
) -> Float[Tensor, ""]:
    """Sum over the batch of the squared errors of both renderings (eq 9)."""
    return ((coarse - truth) ** 2).sum() + ((fine - truth) ** 2).sum()  # eq 9


def fit(
    settings: ReconstructionSpec,
    low: np.ndarray,
    high: np.ndarray,
    first: Frame,
    seed: int,
    course: Course,
    resume: ResumeFile,
) -> dict[str, np.ndarray]:
    """Train both networks on frame 0 from nothing; returns the field's state."""
    chosen = MlpSettings(
        width=settings.mlp_width,
        coarse_samples=settings.coarse_samples,
        fine_samples=settings.fine_samples,
        learning_rate=settings.learning_rate or MlpSettings().learning_rate,
        rays_per_batch=settings.rays_per_batch,
    )
    field = MlpField(low, high, chosen, seed)
    train(field, views_of(first), settings.iterations, seed, course, resume, None)
    return field.state()


def fine_tune(
    settings: ReconstructionSpec,
    parent: Mapping[str, np.ndarray],
    first: Frame,
    frame: Frame,
    seed: int,
    course: Course,
    resume: ResumeFile,
) -> dict[str, np.ndarray]:
    """Train the networks of `parent` on another frame, until what changed has settled; returns the field's state."""
    field = MlpField.of(parent)
    limit = settings.settled_m or SETTLED * float(np.max(field.high - field.low))
    changed = np.argwhere(changed_pixels(first.images, frame.images)).astype(np.int32)
    watched = changed[np.random.default_rng(seed).permutation(len(changed))[:WATCHED]]
    views = views_of(frame)
    settling = Settling(lambda: field.look(views, watched)[2], limit) if len(watched) else None
    train(field, views, settings.fine_tune_iterations, seed, course, resume, settling)
    return field.state()


class Learner:
    """All of a training but the field's weights: optimiser, generators, and how far it is."""

    def __init__(self, field: MlpField, iterations: int, seed: int) -> None:
        self.field = field
        self.iterations = iterations
        self.done = 0
        self._rate = field.settings.learning_rate
        self._generator = torch.Generator(field.device).manual_seed(seed)
        self._rng = np.random.default_rng(seed)
        self._parameters = [*field.coarse.parameters(), *field.fine.parameters()]
        self._optimiser = torch.optim.Adam(self._parameters, lr=self._rate)
        self._mixed = field.device.type == "cuda"
        self._scaler = torch.amp.GradScaler(field.device.type, enabled=self._mixed)

    def step(self, views: Views) -> float:
        """One batch; returns the mean squared error of the fine colours."""
        field = self.field
        pixels = pixels_at(views.drawn(field.settings.rays_per_batch, self._rng), views.images.shape)
        truth = torch.from_numpy(views.images[tuple(pixels.T)]).to(field.device, torch.float32) / 255.0
        with torch.autocast(field.device.type, enabled=self._mixed):
            (coarse, *_), (fine, *_) = field.render(views, pixels, self._generator)
            loss = squared_error(coarse, fine, truth)
        self._optimiser.param_groups[0]["lr"] = self._rate * FALL ** (self.done / self.iterations)
        self._optimiser.zero_grad(set_to_none=True)
        self._scaler.scale(loss).backward()  # type: ignore[no-untyped-call]
        self._scaler.step(self._optimiser)
        self._scaler.update()
        self.done += 1
        return float(((fine.detach() - truth) ** 2).mean())

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `load` needs to go on, the field's weights included."""
        moments = {
            f"adam.{index}.{name}": value.detach().cpu().numpy()
            for index, parameter in enumerate(self._parameters)
            for name, value in self._optimiser.state[parameter].items()
        }
        words = {"rng": self._rng.bit_generator.state, "scaler": self._scaler.state_dict(), "done": self.done}
        generators = {"generator": self._generator.get_state().numpy(), "words": _as_bytes(words)}
        return self.field.state() | moments | generators

    def load(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on where `state` was taken."""
        self.field.load(state)
        for index, parameter in enumerate(self._parameters):
            prefix = f"adam.{index}."
            self._optimiser.state[parameter] = {
                name[len(prefix) :]: torch.from_numpy(state[name].copy()).to(
                    self.field.device if state[name].ndim else "cpu"
                )
                for name in state
                if name.startswith(prefix)
            }
        self._generator.set_state(torch.from_numpy(state["generator"].copy()))
        words = json.loads(state["words"].tobytes())
        self._rng.bit_generator.state = words["rng"]
        self._scaler.load_state_dict(words["scaler"])
        self.done = words["done"]


def train(
    field: MlpField,
    views: Views,
    iterations: int,
    seed: int,
    course: Course,
    resume: ResumeFile,
    settling: Settling | None,
) -> None:
    """Minimise eq 9 for a number of iterations, or until the surface has settled.

    Raises
    ------
    TrainingDiverged
        When the loss is no number, or becomes much worse than it was.
    """
    learner = Learner(field, iterations, seed)
    if (kept := resume.taken_up()) is not None:
        learner.load(kept)
        course.go_on(learner.done, float(kept["loss"]))

    def keep() -> None:
        resume.keep(learner.state() | {"loss": np.array(course.loss)})

    every = max(iterations // LOOKS, 1)
    while learner.done < iterations:
        loss = learner.step(views)
        try:
            course.step(loss, field.settings.rays_per_batch)
        except TrainingDiverged:
            raise
        except BaseException:  # whoever waits asked to stop
            keep()
            raise
        if resume.is_due:
            keep()
        if settling is not None and learner.done % every == 0 and settling.rests():
            return


def _as_bytes(words: Mapping[str, object]) -> np.ndarray:
    return np.frombuffer(json.dumps(words).encode(), dtype=np.uint8)
