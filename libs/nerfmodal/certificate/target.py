"""What a rig is tried on: six thin blades side by side before it, each swinging in three known modes.

The blades lie in one plane that faces the cameras: x runs up its slope along a blade, y is horizontal across, and all
motion is along the normal. Each has an amplitude of its own, from hardly visible to more than a pixel, and each
frequency meets every shape, so that neither is taken for the other.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.geometry.cameras import focus_of
from nerfmodal.geometry.frames import frame_of_box
from nerfmodal.simulate.patches import grid_triangles
from nerfmodal.simulate.shapes import cantilever_shape, shaft_twist
from nerfmodal.spec import Box, OrientedBox
from nerfmodal.types import Camera, Mesh, Rig, TrueMode

AMPLITUDES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Of the blades, in grains: a mode is seen from about a tenth of a grain on."""
FREQUENCIES = (0.067, 0.171, 0.369)
"""In frame rates: low, middle and high of the band, none a sum, difference or double of others."""
SHAPES = ("bending_1", "bending_2", "torsion_1")
DAMPING_RATIO = 0.01
ROWS, COLUMNS = 2, 3
LENGTH, WIDTH, GAP = 0.6, 0.28, 0.12
"""Of a blade, and between blades, in half widths of what all cameras see."""
ALONG, ACROSS = 49, 25
"""Vertices of a blade."""
ROOM = 0.12
"""Of a blade's box above and below it, in half widths."""
CLEAR_OF_GROUND = 0.3
"""Metres: nothing of the board or of the cameras is nearer to the ground, which is in every picture."""
TONES = np.array([[0.10, 0.27, 0.05], [0.33, 0.30, 0.12], [0.45, 0.42, 0.36], [0.16, 0.14, 0.10]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """The blades at rest before a rig that was raised clear of the ground; metres.

    `along` (0..1) and `across` (-1..1) say where on its blade each vertex lies; `normal` is the direction of motion.
    """

    rig: Rig
    mesh: Mesh
    along: Float[np.ndarray, " vertices"]
    across: Float[np.ndarray, " vertices"]
    normal: Float[np.ndarray, " 3"]
    regions: tuple[OrientedBox, ...]
    region: Box
    distance: float
    footprint: float
    grain: float

    def amplitude(self, blade: int) -> float:
        """Metres of each mode of a blade, at its largest point in the first frame."""
        return AMPLITUDES[blade] * self.grain


def board_before(rig: Rig, rng: np.random.Generator, voxels: int) -> Board:
    """The board where a rig's axes meet. `rng` colours it; its finest voxel is its side over `voxels`, or a pixel."""
    center, distance = focus_of(rig)
    half = distance * min(_half_angle(camera) for camera in rig.cameras)
    yaw, pitch = _facing(rig, center)
    side = (ROWS * LENGTH + (ROWS - 1) * GAP) * half
    lowest = min(center[2] - side, *(camera.camera_to_world[2, 3] for camera in rig.cameras))
    raised = np.array([0.0, 0.0, max(0.0, CLEAR_OF_GROUND - lowest)])
    center = center + raised
    regions = _regions(center, half, yaw, pitch)
    parts = [_blade(box, half, rng) for box in regions]
    vertices = np.concatenate([part[0] for part in parts])
    flat = grid_triangles(ALONG, ACROSS)
    one = ALONG * ACROSS
    names = tuple(f"blade_{index}" for index in range(len(regions)))
    low, high = vertices.min(axis=0) - ROOM * half, vertices.max(axis=0) + ROOM * half
    footprint = distance / min(max(camera.focal_x, camera.focal_y) for camera in rig.cameras)
    s, t = np.meshgrid(np.linspace(0, 1, ALONG), np.linspace(-1, 1, ACROSS), indexing="ij")
    return Board(
        rig=_raised(rig, raised),
        mesh=Mesh(
            vertices=vertices,
            triangles=np.concatenate([flat + one * index for index in range(len(regions))]),
            colors=np.concatenate([part[1] for part in parts]),
            organ=np.repeat(np.arange(len(regions)), one),
            organs=names,
        ),
        along=np.tile(s.ravel(), len(regions)),
        across=np.tile(t.ravel(), len(regions)),
        normal=frame_of_box(regions[0]).to_world(np.array([[0.0, 0.0, 1.0]]))[0]
        - frame_of_box(regions[0]).to_world(np.zeros((1, 3)))[0],
        regions=regions,
        region=Box(min_m=_point(low), max_m=_point(high)),
        distance=distance,
        footprint=footprint,
        grain=max(footprint, float((high - low).max()) / voxels),
    )


def true_modes(board: Board, frame_rate: float, times: Float[np.ndarray, " frames"]) -> tuple[TrueMode, ...]:
    """Three modes of every blade: each frequency with another shape from blade to blade."""
    return tuple(
        _mode(board, blade, order, frame_rate, times)
        for blade in range(len(board.regions))
        for order in range(len(FREQUENCIES))
    )


def moved(board: Board, modes: tuple[TrueMode, ...], frame: int) -> Float[np.ndarray, "vertices 3"]:
    """All vertices in a frame of the modes' instants, metres."""
    vertices = board.mesh.vertices.copy()
    for mode in modes:
        vertices[board.mesh.organ == board.mesh.organs.index(mode.organ)] += mode.shape * mode.coordinates[frame]
    return vertices


def _mode(board: Board, blade: int, order: int, frame_rate: float, times: Float[np.ndarray, " frames"]) -> TrueMode:
    mine = board.mesh.organ == blade
    name = SHAPES[(blade + order) % len(SHAPES)]
    size = _shape(name, board.along[mine], board.across[mine])
    frequency = FREQUENCIES[order] * frame_rate
    omega = 2 * np.pi * frequency
    phase = 2 * np.pi * (0.618 * (len(FREQUENCIES) * blade + order) % 1.0)
    decay = np.exp(-DAMPING_RATIO * omega * times)
    swing = np.cos(omega * np.sqrt(1 - DAMPING_RATIO**2) * times + phase)
    return TrueMode(
        organ=board.mesh.organs[blade],
        name=name,
        frequency=frequency,
        damping_ratio=DAMPING_RATIO,
        points=board.mesh.vertices[mine],
        shape=np.outer(size / np.abs(size).max(), board.normal),
        coordinates=board.amplitude(blade) * decay * swing,
    )


def _shape(name: str, s: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    if name == "torsion_1":
        return y * shaft_twist(s)
    return cantilever_shape(s, 1 if name == "bending_1" else 2)


def _half_angle(camera: Camera) -> float:
    """Tangent of half the narrower angle of view."""
    width, height = camera.width / camera.focal_x, camera.height / camera.focal_y
    return 0.5 * float(min(width, height))


def _facing(rig: Rig, center: Float[np.ndarray, " 3"]) -> tuple[float, float]:
    """Yaw and pitch in degrees of a plane that looks at the middle of the cameras."""
    towards = np.mean([camera.camera_to_world[:3, 3] for camera in rig.cameras], axis=0) - center
    azimuth = float(np.degrees(np.arctan2(towards[1], towards[0])))
    elevation = float(np.degrees(np.arctan2(towards[2], np.hypot(towards[0], towards[1]))))
    return (azimuth + 360) % 360 - 180, 90.0 - elevation if elevation > 0 else 90.0


def _regions(center: Float[np.ndarray, " 3"], half: float, yaw: float, pitch: float) -> tuple[OrientedBox, ...]:
    whole = frame_of_box(OrientedBox(center_m=_point(center), size_m=(1.0, 1.0, 1.0), yaw_deg=yaw, pitch_deg=pitch))
    boxes = []
    for row in range(ROWS):
        for column in range(COLUMNS):
            x = (row - (ROWS - 1) / 2) * (LENGTH + GAP) * half
            y = (column - (COLUMNS - 1) / 2) * (WIDTH + GAP) * half
            middle = whole.to_world(np.array([[x, y, 0.0]]))[0]
            size = ((LENGTH + GAP / 2) * half, (WIDTH + GAP / 2) * half, 2 * ROOM * half)
            boxes.append(OrientedBox(center_m=_point(middle), size_m=size, yaw_deg=yaw, pitch_deg=pitch))
    return tuple(boxes)


def _blade(
    box: OrientedBox, half: float, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "vertices 3"]]:
    """Vertices of a slightly arched blade in its box, and its blotches: what a field can hold on to."""
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, ALONG), np.linspace(-0.5, 0.5, ACROSS), indexing="ij")
    arch = 0.15 * ROOM * half * (1 - 4 * s**2)
    local = np.column_stack([LENGTH * half * s.ravel(), WIDTH * half * t.ravel(), arch.ravel()])
    blotches: Int[np.ndarray, "rows columns"] = rng.integers(len(TONES), size=(12, 6))
    rows = np.clip((s.ravel() + 0.5) * 12, 0, 11).astype(int)
    columns = np.clip((t.ravel() + 0.5) * 6, 0, 5).astype(int)
    return frame_of_box(box).to_world(local), TONES[blotches[rows, columns]]


def _raised(rig: Rig, by: Float[np.ndarray, " 3"]) -> Rig:
    cameras = []
    for camera in rig.cameras:
        pose = camera.camera_to_world.copy()
        pose[:3, 3] += by
        cameras.append(replace(camera, camera_to_world=pose))
    return Rig(cameras=tuple(cameras))


def _point(values: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
