"""Training of the grid field on a GPU: the same loss and the same optimiser as the kernels, by torch."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from nerfmodal.field.corners import ROWS_PER_BRICK
from nerfmodal.field.course import Course
from nerfmodal.field.grid import GridField, Rates
from nerfmodal.field.grid_torch import Place, pulls_of, render, show
from nerfmodal.field.kernels import CLEAR
from nerfmodal.field.views import Views, pixels_at

BLOCKS_PER_BRICK = 64
RAYS_AT_ONCE = 16_384


def train(
    field: GridField,
    views: Views,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"] | None,
    draw: Callable[[], Int[np.ndarray, " rays"]],
    iterations: int,
    rng: np.random.Generator,
    course: Course,
    *,
    rates: Rates,
    trainable: np.ndarray,
    decay: float,
    distortion: float,
    limit: float,
    device: torch.device,
) -> Float[np.ndarray, " blocks"]:
    """`grid.train` on `device`; see there."""
    place = Place(field, device)
    learner = Learner(place, trainable)
    for iteration in range(iterations):
        if iteration == iterations // 2:
            learner.seen.zero_()  # what was fog at first may be clear by now
        pixels = pixels_at(draw(), views.images.shape)
        loss, gradient = learner.gradient(
            views, backgrounds, pixels, rng.random(len(pixels)), decay=decay, distortion=distortion, limit=limit
        )
        scale = rates.final ** (course.done / course.total)
        learner.step(gradient, rates.density * scale, rates.color * scale)
        course.step(loss, len(pixels))
    field.values[:] = learner.values.cpu().numpy()
    return np.asarray(learner.seen.cpu().numpy())


class Learner:
    """The values of a field on a device, Adam's moments, and the weights seen in every block."""

    def __init__(self, place: Place, trainable: np.ndarray) -> None:
        self.place = place
        self.values = place.tensor(place.field.values)
        self.seen = torch.zeros(BLOCKS_PER_BRICK * len(place.field.bricks.masks), device=place.device)
        self._first, self._second = torch.zeros_like(self.values), torch.zeros_like(self.values)
        self._steps = 0
        movable = torch.ones(len(self.values), dtype=torch.bool, device=place.device)
        movable[: place.base] = _movable(torch.from_numpy(trainable.view(np.int64)).to(place.device))
        self._movable = movable[:, None]

    def gradient(
        self,
        views: Views,
        backgrounds: UInt8[np.ndarray, "cameras height width 3"] | None,
        pixels: Int[np.ndarray, "rays 3"],
        jitters: Float[np.ndarray, " rays"],
        *,
        decay: float,
        distortion: float,
        limit: float,
    ) -> tuple[float, Float[Tensor, "rows 4"]]:
        """Mean squared error of a batch (eq 9, one field), and the derivative that `kernels.train_batch` takes."""
        place = self.place
        values = self.values.detach().requires_grad_()
        origins, directions, nears = place.rays(views, pixels)
        jitter = torch.from_numpy(jitters).to(place.device)
        inner, fars = place.inner(origins, directions, nears, jitter)
        front = show(values, inner, torch.ones(len(pixels), device=place.device), ends=False)
        self._mark(inner.rows[:, 0], front.weights.detach())
        where = tuple(pixels.T)
        pull = (pulls_of(inner, front.weights, len(pixels)) * front.weights).sum() * distortion
        emptiness = (torch.nn.functional.softplus(front.raw) * inner.delta * (front.weights.detach() > 0)).sum()
        if backgrounds is None:
            outer = place.beyond(origins, directions, fars, jitter)
            back = show(values, outer, front.left, ends=True)
            colors = front.colors + back.colors
            if place.field.outer.size == 0:  # rays that meet the structure teach the ground nothing
                still = show(values.detach(), outer, front.left, ends=True)
                met_structure = front.left.detach()[:, None] < CLEAR
                colors = front.colors + torch.where(met_structure, still.colors, back.colors)
            met = back.weights.detach() > 0
            emptiness = emptiness + (torch.nn.functional.softplus(back.raw) * outer.delta * met).sum()
        else:
            colors = front.colors + front.left[:, None] * place.tensor(backgrounds[where]) / 255.0
        difference = (colors - place.tensor(views.images[where]) / 255.0).detach()
        error = 2.0 * difference.clamp(-limit, limit)
        surrogate = (error * colors).sum() + pull + decay * emptiness
        (gradient,) = torch.autograd.grad(surrogate, values)
        return float((difference**2).mean()), gradient  # eq 9

    def step(self, gradient: Float[Tensor, "rows 4"], density_rate: float, color_rate: float) -> None:
        """Adam on the values that the batch touched and that may move (see `kernels.adam`)."""
        self._steps += 1
        moves = (gradient != 0) & self._movable
        first = 0.9 * self._first + 0.1 * gradient
        second = 0.99 * self._second + 0.01 * gradient**2
        rates = self.values.new_tensor([density_rate, color_rate, color_rate, color_rate])
        size = (second / (1.0 - 0.99**self._steps)).sqrt() + 1e-10
        change = rates * first / (1.0 - 0.9**self._steps) / size
        self._first = torch.where(moves, first, self._first)
        self._second = torch.where(moves, second, self._second)
        self.values = torch.where(moves, self.values - change, self.values)

    def _mark(self, rows: Int[Tensor, " samples"], weights: Float[Tensor, " samples"]) -> None:
        local = rows % ROWS_PER_BRICK
        bit = ((local >> 6) >> 1 << 4) | (((local >> 3) & 7) >> 1 << 2) | ((local & 7) >> 1)
        block = rows // ROWS_PER_BRICK * BLOCKS_PER_BRICK + bit
        self.seen.scatter_reduce_(0, block, weights, "amax")


def _movable(masks: Int[Tensor, " bricks"]) -> Tensor:
    """Which vertices belong to a block whose bit is set."""
    local = torch.arange(ROWS_PER_BRICK, device=masks.device)
    bit = ((local >> 6) >> 1 << 4) | (((local >> 3) & 7) >> 1 << 2) | ((local & 7) >> 1)
    return ((masks[:, None] >> bit) & 1).bool().reshape(-1)


def look(
    field: GridField, views: Views, pixels: Int[np.ndarray, "rays 3"], *, behind: bool, device: torch.device
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`grid.render` on `device`; see there."""
    place = Place(field, device)
    values = place.tensor(field.values)
    blocks = np.split(pixels, range(RAYS_AT_ONCE, len(pixels), RAYS_AT_ONCE))
    parts = [render(place, values, views, block, behind=behind) for block in blocks]
    front, left, back, distance, spread = (np.concatenate(values) for values in zip(*parts, strict=True))
    return front, left, back, distance, spread
