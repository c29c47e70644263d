"""A film of each mode alone (eq 17 with beta = 0): one swing of the magnified mode as pictures, and as MP4 and GIF.

Orthographic, painted from far to near. The swing is magnified to a share of the organ's length and slowed to
`SECONDS`; a line on the picture says both. Colour is the displacement along the mode's main direction, as in Figure 8.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib import colormaps
from PIL import Image, ImageDraw, ImageFont

from nerfmodal.figures.encode import FRAMES_PER_SECOND, write_gif, write_mp4
from nerfmodal.figures.shapes import DrawnMode, drawn_mode, reach_of
from nerfmodal.figures.style import SIGNED_MAP, measured
from nerfmodal.figures.view import View, far_to_near, light, nice_length, view_across
from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult

SIZE = (560, 400)
"""Pixels across and down."""
SECONDS = 1.6
"""Of one swing on the screen."""
SWINGS = 2
"""In the MP4; the GIF holds one and repeats it."""
FINER = 2
"""Pictures are painted this much larger and reduced: smooth edges."""
HEAD, FOOT, SIDE = 52, 42, 24
"""Pixels kept free above, below and at the sides."""
INK, SOFT, REST = (27, 27, 27), (92, 92, 92), (140, 140, 140)


@dataclass(frozen=True, slots=True, kw_only=True)
class Screen:
    """The view, what is in its middle (metres to the right and up), and pixels per metre."""

    view: View
    middle: Float[np.ndarray, " 2"]
    scale: float

    def project(self, points: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 3"]:
        """Pixels of the larger painting: to the right, down, and towards the eye."""
        seen = self.view.project(points)
        seen[..., 0] = FINER * (SIZE[0] / 2 + self.scale * (seen[..., 0] - self.middle[0]))
        seen[..., 1] = FINER * ((SIZE[1] + HEAD - FOOT) / 2 - self.scale * (seen[..., 1] - self.middle[1]))
        seen[..., 2] *= FINER * self.scale
        return seen


def write_film(organ: OrganResult, k: int, folder: Path) -> tuple[Path, Path]:
    """Write `<organ>_mode_<k>.mp4` and `.gif` of mode `k` (counted from 0) into `folder`."""
    frames = film(organ, k)
    video, animation = (folder / f"{organ.organ}_mode_{k}.{suffix}" for suffix in ("mp4", "gif"))
    with atomic_write(video) as temporary:
        write_mp4(np.concatenate([frames] * SWINGS), temporary)
    with atomic_write(animation) as temporary:
        write_gif(frames, temporary)
    return video, animation


def film(organ: OrganResult, k: int) -> UInt8[np.ndarray, "frames height width 3"]:
    """One swing of mode `k`, from its largest displacement back to it."""
    mode = drawn_mode(organ, k)
    screen = screen_of(mode)
    words = _words(organ, k, screen)
    count = round(SECONDS * FRAMES_PER_SECOND)
    swings = np.cos(2 * np.pi * np.arange(count // 2 + 1) / count)
    half = [np.minimum(_picture(mode, screen, float(swing)), words) for swing in swings]
    return np.stack(half + half[-2:0:-1])  # the way back is the way there


def screen_of(mode: DrawnMode) -> Screen:
    """The screen that holds everything the film reaches."""
    view = view_across(mode.rest, mode.direction)
    seen = view.project(reach_of([mode]))[:, :2]
    span = np.maximum(np.ptp(seen, axis=0), 1e-9)
    scale = min((SIZE[0] - 2 * SIDE) / span[0], (SIZE[1] - HEAD - FOOT) / span[1])
    return Screen(view=view, middle=(seen.min(axis=0) + seen.max(axis=0)) / 2, scale=float(scale))


def _picture(mode: DrawnMode, screen: Screen, coordinate: float) -> np.ndarray:
    image = Image.new("RGB", (FINER * SIZE[0], FINER * SIZE[1]), "white")
    draw = ImageDraw.Draw(image)
    places = screen.project(mode.rest + coordinate * mode.magnification * mode.motion)
    if len(mode.triangles):
        _faces(draw, mode, places, coordinate)
    else:
        _dots(draw, places, _colors(coordinate * mode.signed))
    for line in screen.project(mode.rest_lines)[:, :, :2]:
        draw.line(line.ravel().tolist(), fill=REST, width=FINER)
    return np.asarray(image.resize(SIZE, Image.Resampling.BOX))


def _faces(draw: ImageDraw.ImageDraw, mode: DrawnMode, places: np.ndarray, coordinate: float) -> None:
    corners = places[mode.triangles]
    brightness = light(corners, mode.triangles)
    colors = (_colors(coordinate * mode.signed[mode.triangles].mean(axis=1)) * brightness[:, None]).astype(int)
    for face in far_to_near(corners):
        draw.polygon(corners[face, :, :2].ravel().tolist(), fill=tuple(colors[face].tolist()))


def _dots(draw: ImageDraw.ImageDraw, places: np.ndarray, colors: np.ndarray) -> None:
    for (x, y), color in zip(places[:, :2], colors.tolist(), strict=True):
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=tuple(color))


def _colors(signed: np.ndarray) -> np.ndarray:
    """Red, green, blue of displacements from -1 to 1."""
    return np.asarray(255 * colormaps[SIGNED_MAP]((signed + 1) / 2)[:, :3]).astype(np.uint8)


def _words(organ: OrganResult, k: int, screen: Screen) -> np.ndarray:
    """On white: what is shown, above; a length and the colours' meaning, below."""
    image = Image.new("RGB", SIZE, "white")
    draw = ImageDraw.Draw(image)
    frequency, std = float(organ.model.frequencies[k]), float(organ.model.frequency_stds[k])
    draw.text((12, 8), f"{organ.organ}, mode {k}: {measured(frequency, std)} Hz", INK, _font(17))
    draw.text((12, 31), f"magnified, {_slowed(frequency)}", SOFT, _font(12))
    length = nice_length(0.25 * SIZE[0] / screen.scale)
    right, level = 12 + length * screen.scale, SIZE[1] - 14
    draw.line((12, level, right, level), fill=INK, width=2)
    draw.text((12, level - 18), f"{length:g} m", INK, _font(12))
    _bar(draw)
    return np.asarray(image)


def _slowed(frequency: float) -> str:
    factor = SECONDS * frequency
    return f"{factor:.3g} times slower" if factor >= 1 else f"{1 / factor:.3g} times faster"


def _bar(draw: ImageDraw.ImageDraw) -> None:
    left, top, width = SIZE[0] - 152, SIZE[1] - 18, 140
    for step, color in enumerate(_colors(np.linspace(-1, 1, width)).tolist()):
        draw.line((left + step, top, left + step, top + 7), fill=tuple(color))
    draw.text((left, top - 17), "-1", INK, _font(12))
    draw.text((left + width, top - 17), "1", INK, _font(12), anchor="ra")
    draw.text((left + width / 2, top - 17), "of largest", INK, _font(12), anchor="ma")


def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)
