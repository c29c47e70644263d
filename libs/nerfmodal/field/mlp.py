"""The paper's field: coarse and fine networks, hierarchical sampling, eq 9; on a GPU where there is one.

Space is scaled so that the region is [-1, 1] in every axis, contracted beyond it (mip-NeRF 360, Barron et al. 2022) and
halved, so that the encoding's position lies in [-1, 1] everywhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from nerfmodal.field.networks import RadianceField
from nerfmodal.field.rendering import composite, composite_weights, depth_at, intervals
from nerfmodal.field.sampling import importance_samples, stratified_samples
from nerfmodal.field.views import Views, directions_of

REACH = 4.0
"""Rays end this many half-diagonals of the region behind its centre."""

QUARTILES = (0.25, 0.5, 0.75)

Rendered = tuple[Float[Tensor, "rays 3"], Float[Tensor, " rays"], Float[Tensor, " rays"], Float[Tensor, " rays"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class MlpSettings:
    """What the user chooses of the paper's field."""

    width: int = 256
    coarse_samples: int = 64
    fine_samples: int = 192
    learning_rate: float = 5e-4
    rays_per_batch: int = 4096


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

    @torch.no_grad()
    def look(
        self, views: Views, pixels: Int[np.ndarray, "rays 3"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Colour (rays, 3), opacity within the region, median distance and its spread (rays,) m; nothing random."""
        parts = []
        for start in range(0, len(pixels), self.settings.rays_per_batch):
            block = pixels[start : start + self.settings.rays_per_batch]
            _, rendered = self.render(views, block, None)
            parts.append([value.float().cpu().numpy() for value in rendered])
        colors, opacity, distance, spread = (np.concatenate(values) for values in zip(*parts, strict=True))
        return colors, opacity, distance, spread

    def render(
        self, views: Views, pixels: Int[np.ndarray, "rays 3"], generator: torch.Generator | None
    ) -> tuple[Rendered, Rendered]:
        """Coarse and fine colour, opacity within the region, distance and spread of rays; random by `generator`."""
        origins = torch.from_numpy(views.poses[pixels[:, 0], :3, 3]).to(self.device, torch.float32)
        directions = torch.from_numpy(directions_of(views, pixels)).to(self.device, torch.float32)
        center = torch.from_numpy((self.low + self.high) / 2).to(self.device, torch.float32)
        radius = float(np.linalg.norm(self.high - self.low)) / 2
        away = (center - origins).norm(dim=-1)
        nears, fars = (away - radius).clamp(min=0.02 * radius), away + REACH * radius
        t, edges = stratified_samples(nears, fars, self.settings.coarse_samples, generator)
        coarse, weights = self._composite(self.coarse, origins, directions, t, fars)
        more = importance_samples(edges, weights.detach(), self.settings.fine_samples, generator)
        union, _ = torch.sort(torch.cat([t, more], dim=-1), dim=-1)
        fine, _ = self._composite(self.fine, origins, directions, union, fars)
        return coarse, fine

    def _composite(
        self, network: RadianceField, origins: Tensor, directions: Tensor, t: Tensor, fars: Tensor
    ) -> tuple[Rendered, Tensor]:
        points = origins[:, None] + t[..., None] * directions[:, None]
        scaled = self._scaled(points)
        seen = directions[:, None].expand_as(points)
        density, colors = network(self._contracted(scaled).reshape(-1, 3), seen.reshape(-1, 3))
        unit = float(np.linalg.norm(self.high - self.low)) / 2
        delta = intervals(t, fars) / unit
        weights, _ = composite_weights(density.reshape(t.shape).float(), delta)
        inside = weights * (scaled.abs().amax(dim=-1) <= 1.0).float()
        opacity = inside.sum(dim=-1)
        near, middle, far = (depth_at(inside, t, share * opacity) for share in QUARTILES)
        return (composite(weights, colors.reshape(*t.shape, 3).float()), opacity, middle, far - near), weights

    def _scaled(self, points: Tensor) -> Tensor:
        low = torch.from_numpy(self.low).to(points)
        high = torch.from_numpy(self.high).to(points)
        return (points - low) / (high - low) * 2.0 - 1.0

    @staticmethod
    def _contracted(scaled: Tensor) -> Tensor:
        r = scaled.abs().amax(dim=-1, keepdim=True).clamp(min=1.0)
        return scaled * (2.0 - 1.0 / r) / r / 2.0
