"""The paper's field: coarse and fine networks, hierarchical sampling, eq 9; on a GPU where there is one.

Space is scaled so that the region is [-1, 1] in every axis, contracted beyond it (mip-NeRF 360, Barron et al. 2022) and
halved, so that the encoding's position lies in [-1, 1] everywhere.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from nerfmodal.errors import TrainingDiverged
from nerfmodal.field.networks import RadianceField
from nerfmodal.field.rendering import composite, composite_weights, depth_at, intervals
from nerfmodal.field.sampling import importance_samples, stratified_samples
from nerfmodal.field.views import Views, directions_of, pixels_at

REACH = 4.0
"""Rays end this many half-diagonals of the region behind its centre."""

Rendered = tuple[Float[Tensor, "rays 3"], Float[Tensor, " rays"], Float[Tensor, " rays"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class MlpSettings:
    """What the user chooses of the paper's field."""

    width: int = 256
    coarse_samples: int = 64
    fine_samples: int = 192
    learning_rate: float = 5e-4
    rays_per_batch: int = 4096


def squared_error(
    coarse: Float[Tensor, "rays 3"], fine: Float[Tensor, "rays 3"], truth: Float[Tensor, "rays 3"]
) -> Float[Tensor, ""]:
    """Sum over the batch of the squared errors of both renderings (eq 9)."""
    return ((coarse - truth) ** 2).sum() + ((fine - truth) ** 2).sum()  # eq 9


class MlpField:
    """The two networks and the box they live in."""

    def __init__(self, low: np.ndarray, high: np.ndarray, settings: MlpSettings, seed: int) -> None:
        self.low, self.high, self.settings = low, high, settings
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.coarse = RadianceField(settings.width).to(self.device)
            self.fine = RadianceField(settings.width).to(self.device)

    def state(self) -> dict[str, np.ndarray]:
        """Everything `load` needs, as arrays."""
        weights = {
            f"{name}.{key}": value.detach().cpu().numpy()
            for name, network in (("coarse", self.coarse), ("fine", self.fine))
            for key, value in network.state_dict().items()
        }
        samples = [self.settings.width, self.settings.coarse_samples, self.settings.fine_samples]
        box = {"low": self.low, "high": self.high, "samples": np.array(samples)}
        return weights | box | {"rates": np.array([self.settings.learning_rate, self.settings.rays_per_batch])}

    @classmethod
    def of(cls, state: Mapping[str, np.ndarray]) -> "MlpField":
        """The field whose `state` this is."""
        width, coarse, fine = (int(value) for value in state["samples"])
        rate, rays = state["rates"]
        settings = MlpSettings(
            width=width, coarse_samples=coarse, fine_samples=fine, learning_rate=float(rate), rays_per_batch=int(rays)
        )
        field = cls(state["low"], state["high"], settings, 0)
        field.load(state)
        return field

    def load(self, state: Mapping[str, np.ndarray]) -> None:
        """Take over weights that `state` gave."""
        for name, network in (("coarse", self.coarse), ("fine", self.fine)):
            prefix = f"{name}."
            network.load_state_dict(
                {key[len(prefix) :]: torch.from_numpy(state[key].copy()) for key in state if key.startswith(prefix)}
            )

    def train(
        self,
        views: Views,
        iterations: int,
        seed: int,
        told: Callable[[int, float], None],
    ) -> float:
        """Minimise eq 9 for a number of iterations; returns the smoothed mean squared error of the fine colours.

        Raises
        ------
        TrainingDiverged
            When the loss is no number.
        """
        generator = torch.Generator(self.device).manual_seed(seed)
        rng = np.random.default_rng(seed)
        parameters = [*self.coarse.parameters(), *self.fine.parameters()]
        optimiser = torch.optim.Adam(parameters, lr=self.settings.learning_rate)
        schedule = torch.optim.lr_scheduler.ExponentialLR(optimiser, 0.1 ** (1.0 / max(iterations, 1)))
        mixed = self.device.type == "cuda"
        scaler = torch.amp.GradScaler(self.device.type, enabled=mixed)
        smooth = 0.0
        for iteration in range(iterations):
            pixels = pixels_at(rng.integers(0, views.pixels, self.settings.rays_per_batch), views.images.shape)
            truth = torch.from_numpy(views.images[tuple(pixels.T)]).to(self.device, torch.float32) / 255.0
            with torch.autocast(self.device.type, enabled=mixed):
                (coarse, _, _), (fine, _, _) = self._render(views, pixels, generator)
                loss = squared_error(coarse, fine, truth)
            optimiser.zero_grad(set_to_none=True)
            scaler.scale(loss).backward()  # type: ignore[no-untyped-call]
            scaler.step(optimiser)
            scaler.update()
            schedule.step()
            error = float(((fine.detach() - truth) ** 2).mean())
            if not np.isfinite(error):
                raise TrainingDiverged(f"the loss became {error} at iteration {iteration}.")
            smooth = error if iteration == 0 else 0.9 * smooth + 0.1 * error
            told(iteration + 1, smooth)
        return smooth

    @torch.no_grad()
    def look(
        self, views: Views, pixels: Int[np.ndarray, "rays 3"], level: float = 0.5
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Colour (rays, 3), opacity within the region (rays,) and distance at `level` (rays,) m; nothing random."""
        parts = []
        for start in range(0, len(pixels), self.settings.rays_per_batch):
            block = pixels[start : start + self.settings.rays_per_batch]
            _, rendered = self._render(views, block, None, level)
            parts.append([value.float().cpu().numpy() for value in rendered])
        colors, opacity, distance = (np.concatenate(values) for values in zip(*parts, strict=True))
        return colors, opacity, distance

    def _render(
        self, views: Views, pixels: Int[np.ndarray, "rays 3"], generator: torch.Generator | None, level: float = 0.5
    ) -> tuple[Rendered, Rendered]:
        origins = torch.from_numpy(views.poses[pixels[:, 0], :3, 3]).to(self.device, torch.float32)
        directions = torch.from_numpy(directions_of(views, pixels)).to(self.device, torch.float32)
        center = torch.from_numpy((self.low + self.high) / 2).to(self.device, torch.float32)
        radius = float(np.linalg.norm(self.high - self.low)) / 2
        away = (center - origins).norm(dim=-1)
        nears, fars = (away - radius).clamp(min=0.02 * radius), away + REACH * radius
        t, edges = stratified_samples(nears, fars, self.settings.coarse_samples, generator)
        coarse, weights = self._composite(self.coarse, origins, directions, t, fars, level)
        more = importance_samples(edges, weights.detach(), self.settings.fine_samples, generator)
        union, _ = torch.sort(torch.cat([t, more], dim=-1), dim=-1)
        fine, _ = self._composite(self.fine, origins, directions, union, fars, level)
        return coarse, fine

    def _composite(
        self, network: RadianceField, origins: Tensor, directions: Tensor, t: Tensor, fars: Tensor, level: float
    ) -> tuple[Rendered, Tensor]:
        points = origins[:, None] + t[..., None] * directions[:, None]
        scaled = self._scaled(points)
        seen = directions[:, None].expand_as(points)
        density, colors = network(self._contracted(scaled).reshape(-1, 3), seen.reshape(-1, 3))
        unit = float(np.linalg.norm(self.high - self.low)) / 2
        delta = intervals(t, fars) / unit
        weights, _ = composite_weights(density.reshape(t.shape).float(), delta)
        inside = (scaled.abs().amax(dim=-1) <= 1.0).float()
        image = composite(weights, colors.reshape(*t.shape, 3).float())
        return (image, (weights * inside).sum(dim=-1), depth_at(weights * inside, t, level)), weights

    def _scaled(self, points: Tensor) -> Tensor:
        low = torch.from_numpy(self.low).to(points)
        high = torch.from_numpy(self.high).to(points)
        return (points - low) / (high - low) * 2.0 - 1.0

    @staticmethod
    def _contracted(scaled: Tensor) -> Tensor:
        r = scaled.abs().amax(dim=-1, keepdim=True).clamp(min=1.0)
        return scaled * (2.0 - 1.0 / r) / r / 2.0
