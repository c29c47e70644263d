"""The grid field on a GPU: the samples of `marching`, all rays of a batch at once; derivatives by autograd.

Held to the kernels by tests, in values and in gradients. Samples of one ray follow each other in flat arrays; sums
along a ray are differences of one running sum (in double precision).
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from nerfmodal.field.corners import CORNERS, EMPTY_RAW, ROWS_PER_BRICK
from nerfmodal.field.grid import STEP, GridField
from nerfmodal.field.kernels import FAINTEST
from nerfmodal.field.marching import MAX_SAMPLES, OPAQUE
from nerfmodal.field.views import Views, directions_of

SKY_RADIUS = 60.0
"""Half-extents of the region at which the outer grid ends."""
SKY_THICKNESS = 1e4


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Samples of many rays, those of one ray together and in order; rows of -1 are vertices that do not exist."""

    ray: Int[Tensor, " samples"]
    t: Float[Tensor, " samples"]
    delta: Float[Tensor, " samples"]
    rows: Int[Tensor, "samples 8"]
    shares: Float[Tensor, "samples 8"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What rays show: of each sample its weight (eq 8) and raw density, of each ray its colour and light left."""

    weights: Float[Tensor, " samples"]
    raw: Float[Tensor, " samples"]
    colors: Float[Tensor, "rays 3"]
    left: Float[Tensor, " rays"]


class Place:
    """The layout of a field on a device; its values are given to each call."""

    def __init__(self, field: GridField, device: torch.device) -> None:
        self.field = field
        self.device = device
        self.slots = torch.from_numpy(field.bricks.slots.clip(min=-1)).to(device, torch.long)
        self.masks = torch.from_numpy(field.bricks.masks.view(np.int64)).to(device)
        self.outer = torch.from_numpy(field.outer).to(device, torch.long)
        self.base = len(field.bricks.masks) * ROWS_PER_BRICK

    def tensor(self, values: np.ndarray) -> Float[Tensor, "..."]:
        """An array in single precision on the device."""
        return torch.from_numpy(np.ascontiguousarray(values)).to(self.device, torch.float32)

    def rays(self, views: Views, pixels: Int[np.ndarray, "rays 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """Origins and unit directions (rays, 3), and where to begin (rays,), metres, in double precision."""
        origins = torch.from_numpy(views.poses[pixels[:, 0], :3, 3]).to(self.device)
        nears = torch.from_numpy(views.nears[pixels[:, 0]]).to(self.device)
        return origins, torch.from_numpy(directions_of(views, pixels)).to(self.device), nears

    def inner(self, origins: Tensor, directions: Tensor, nears: Tensor, jitters: Tensor) -> tuple[Samples, Tensor]:
        """Samples in the blocks that are set (as `marching.march_inner`), and where rays go on behind it (m)."""
        voxel = self.field.bricks.voxel
        extent = torch.from_numpy(2.0 * self.field.half / voxel).to(self.device)
        start = (origins - torch.from_numpy(self.field.bricks.low).to(self.device)) / voxel
        near, far = _box_span(start, directions, extent)
        near = torch.maximum(near, nears / voxel)
        count = max(math.ceil(float((far - near).clamp(min=0).max()) / STEP), 1)
        t = near[:, None] + (jitters[:, None] + torch.arange(count, device=self.device)) * STEP
        place = start[:, None] + directions[:, None] * t[..., None]
        place = torch.minimum(place.clamp(min=0), extent - 1e-3)
        cell = place.long()
        ray, index = torch.nonzero(self._is_set(cell) & (t < far[:, None]), as_tuple=True)
        rows, shares = self._corners(self.slots, 0, place[ray, index])
        delta = torch.full_like(ray, STEP, dtype=torch.float32)
        samples = Samples(ray=ray, t=t[ray, index].float(), delta=delta, rows=rows, shares=shares)
        return samples, torch.maximum(far * voxel, nears)

    def beyond(self, origins: Tensor, directions: Tensor, starts: Tensor, jitters: Tensor) -> Samples:
        """What lies behind the region (as `marching.march_beyond`): the outer grid, or the ground and the sky."""
        if self.field.outer.size == 0:
            return self._ground(origins, directions)
        half = torch.from_numpy(self.field.half).to(self.device)
        center = torch.from_numpy(self.field.bricks.low + self.field.half).to(self.device)
        cells = self.field.outer.shape[0] * 8 - 1
        rays: list[Tensor] = []
        places: list[Tensor] = []
        distances: list[Tensor] = []
        last: list[Tensor] = []
        t, active, first = starts, torch.arange(len(starts), device=self.device), True
        while len(active) and len(rays) < MAX_SAMPLES:
            scaled = (origins[active] + directions[active] * t[:, None] - center) / half
            r = scaled.abs().amax(dim=1).clamp(min=1.0)
            advance = 4.0 / cells * r * torch.minimum(r, 3.0 + 0.1 * r) * float(self.field.half.min())
            if first:
                t, first = t + advance * jitters, False
                continue
            shrink = (2.0 - 1.0 / r) / r
            rays.append(active)
            distances.append(t)
            last.append(r > SKY_RADIUS)
            places.append(((scaled * shrink[:, None] + 2.0) * 0.25).clamp(max=0.9999) * cells)
            t, active = (t + advance)[~last[-1]], active[~last[-1]]
        ray = torch.cat(rays)
        order = torch.argsort(ray, stable=True)
        rows, shares = self._corners(self.outer, self.base, torch.cat(places)[order])
        delta = torch.where(torch.cat(last)[order], SKY_THICKNESS, 1.0).float()
        return Samples(ray=ray[order], t=torch.cat(distances)[order].float(), delta=delta, rows=rows, shares=shares)

    def _is_set(self, cell: Int[Tensor, "... 3"]) -> Bool[Tensor, "..."]:
        slot = self.slots[tuple((cell >> 3).unbind(-1))]
        x, y, z = ((cell & 7) >> 1).unbind(-1)
        bit = (x << 4) | (y << 2) | z
        masks = torch.cat([self.masks, self.masks.new_zeros(1)])  # the last stands for no brick
        return ((masks[slot] >> bit) & 1).bool()

    def _corners(
        self, slots: Tensor, base: int, place: Float[Tensor, "samples 3"]
    ) -> tuple[Int[Tensor, "samples 8"], Float[Tensor, "samples 8"]]:
        cell = place.long()
        part = (place - cell).float()
        offsets = torch.tensor([[c >> 2, (c >> 1) & 1, c & 1] for c in range(len(CORNERS))], device=self.device)
        corner = cell[:, None] + offsets
        slot = slots[tuple((corner >> 3).unbind(-1))]
        x, y, z = (corner & 7).unbind(-1)
        rows = torch.where(slot < 0, -1, base + slot * ROWS_PER_BRICK + (x << 6 | y << 3 | z))
        return rows, torch.where(offsets.bool(), part[:, None], 1.0 - part[:, None]).prod(dim=-1)

    def _ground(self, origins: Tensor, directions: Tensor) -> Samples:
        half = torch.from_numpy(self.field.half).to(self.device)
        center = torch.from_numpy(self.field.bricks.low + self.field.half).to(self.device)
        height, along_x, along_y = (float(value) for value in self.field.ground)
        nears = directions[:, 2] - along_x * directions[:, 0] - along_y * directions[:, 1]
        above = origins[:, 2] - height - along_x * origins[:, 0] - along_y * origins[:, 1]
        falls = (nears < -1e-4) & (above > 0)
        t = torch.where(falls, -above / nears, 1e3)
        flat = ((origins + directions * t[:, None] - center) / half)[:, :2]
        r = flat.abs().amax(dim=1, keepdim=True).clamp(min=1.0)
        ground = 0.5 + flat * ((2.0 - 1.0 / r) / r * 0.25)
        x, y, z = directions.unbind(-1)
        sky = torch.stack([0.5 + torch.atan2(y, x) / (2 * math.pi), 0.5 + torch.asin(z.clamp(-1, 1)) / math.pi], dim=1)
        side = torch.where(falls, self.field.sides[0], self.field.sides[1])
        start = self.base + torch.where(falls, 0, self.field.sides[0] ** 2)
        rows, shares = _texels(torch.where(falls[:, None], ground, sky), start, side)
        ray = torch.arange(len(t), device=self.device)
        return Samples(ray=ray, t=t.float(), delta=torch.zeros_like(t, dtype=torch.float32), rows=rows, shares=shares)


def show(values: Float[Tensor, "rows 4"], samples: Samples, before: Float[Tensor, " rays"], *, ends: bool) -> Shown:
    """Composite samples (eq 3) of rays that have `before` of their light left; `ends`: the last sample is opaque."""
    padded = torch.cat([values, values.new_tensor([[float(EMPTY_RAW), 0.0, 0.0, 0.0]])])  # row -1: no such vertex
    mixed = (padded[samples.rows] * samples.shares[..., None]).sum(dim=1)
    raw, colors = mixed[:, 0], mixed[:, 1:]
    thickness = torch.nn.functional.softplus(raw) * samples.delta
    rays = len(before)
    transmittance = before[samples.ray] * torch.exp(-_sum_before(thickness, samples.ray, rays))  # eq 3: T_i
    kept = (transmittance.detach() >= OPAQUE).float()
    weights = transmittance * -torch.expm1(-thickness) * kept  # eq 8: w_i
    if ends:
        is_last = torch.ones_like(samples.ray, dtype=torch.bool)
        is_last[:-1] = samples.ray[1:] != samples.ray[:-1]
        weights = torch.where(is_last, transmittance * kept, weights)
    shown = torch.zeros(rays, 3, device=values.device).index_add(0, samples.ray, weights[:, None] * colors)  # eq 3
    spent = torch.zeros(rays, device=values.device).index_add(0, samples.ray, thickness * kept)
    return Shown(weights=weights, raw=raw, colors=shown, left=before * torch.exp(-spent))


def pulls_of(samples: Samples, weights: Float[Tensor, " samples"], rays: int) -> Float[Tensor, " samples"]:
    """Derivative of every ray's distortion by each weight (mip-NeRF 360, eq 15), as `kernels.gather_pulls`."""
    t, w = samples.t.double(), weights.detach().double()
    mass, moment = (_sum_before(values, samples.ray, rays) for values in (w, w * t))
    total = torch.zeros(2, rays, dtype=torch.float64, device=w.device)
    total = total.index_add(1, samples.ray, torch.stack([w, w * t]))[:, samples.ray]
    mass_after, moment_after = total[0] - mass - w, total[1] - moment - w * t
    pairs = t * (mass - mass_after) + moment_after - moment
    return (2.0 * pairs + 2.0 / 3.0 * w * samples.delta).float()


@torch.no_grad()
def render(
    place: Place, values: Float[Tensor, "rows 4"], views: Views, pixels: Int[np.ndarray, "rays 3"], *, behind: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What `kernels.render_pixels` gives: colour in front, light left, colour behind, distance and spread (m)."""
    origins, directions, nears = place.rays(views, pixels)
    middle = torch.full((len(pixels),), 0.5, device=place.device, dtype=origins.dtype)
    whole = torch.ones(len(pixels), device=place.device)
    samples, fars = place.inner(origins, directions, nears, middle)
    front = show(values, samples, whole, ends=False)
    opacity = 1.0 - front.left
    near, half, far = (_crossing(samples, front.weights, share * opacity) for share in (0.25, 0.5, 0.75))
    met = (opacity > FAINTEST).float() * place.field.bricks.voxel
    colors = torch.zeros_like(front.colors)
    if behind:
        beyond = place.beyond(origins, directions, fars, middle)
        colors = show(values, beyond, whole, ends=True).colors
    results = (front.colors, front.left, colors, half * met, (far - near) * met)
    parts = [one.float().cpu().numpy() for one in results]
    return parts[0], parts[1], parts[2], parts[3], parts[4]


def _crossing(
    samples: Samples, weights: Float[Tensor, " samples"], target: Float[Tensor, " rays"]
) -> Float[Tensor, " rays"]:
    """Where each ray's accumulated weight passes `target`, voxels."""
    gone = _sum_before(weights, samples.ray, len(target))
    aim = target[samples.ray]
    crosses = (gone < aim) & (gone + weights >= aim)
    place = samples.t + ((aim - gone) / weights.clamp(min=1e-9) - 0.5) * samples.delta
    found = torch.zeros_like(target)
    found[samples.ray[crosses]] = place[crosses]
    return found


def _sum_before(values: Float[Tensor, " samples"], ray: Int[Tensor, " samples"], rays: int) -> Tensor:
    """Of each sample the sum of the values before it on its ray."""
    if not len(values):
        return values
    running = values.double().cumsum(0)
    counts = torch.bincount(ray, minlength=rays)
    first = counts.cumsum(0) - counts
    before = torch.cat([running.new_zeros(1), running])
    return (running - values.double() - before[first[ray]]).to(values.dtype)


def _box_span(start: Tensor, directions: Tensor, extent: Tensor) -> tuple[Tensor, Tensor]:
    inverse = 1.0 / torch.where(directions.abs() < 1e-12, 1e-12, directions)
    first, second = -start * inverse, (extent - start) * inverse
    near = torch.minimum(first, second).amax(dim=1).clamp(min=0.0)
    return near, torch.maximum(first, second).amin(dim=1)


def _texels(
    place: Float[Tensor, "rays 2"], start: Int[Tensor, " rays"], side: Int[Tensor, " rays"]
) -> tuple[Int[Tensor, "rays 8"], Float[Tensor, "rays 8"]]:
    """Rows and shares of the four texels around a place in 0..1 of a square texture, padded to eight."""
    scaled = place.clamp(0.0, 1.0) * (side[:, None] - 1.001)
    cell = scaled.long()
    part = (scaled - cell).float()
    corner = torch.tensor([[0, 0], [0, 1], [1, 0], [1, 1]], device=place.device)
    at = cell[:, None] + corner
    rows = start[:, None] + at[..., 0] * side[:, None] + at[..., 1]
    shares = torch.where(corner.bool(), part[:, None], 1.0 - part[:, None]).prod(dim=-1)
    return torch.nn.functional.pad(rows, (0, 4), value=-1), torch.nn.functional.pad(shares, (0, 4))
