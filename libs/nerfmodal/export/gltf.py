"""A mode as an animated picture in space: binary glTF 2.0, the shape as a morph target that swings.

Sensors are points in world coordinates (metres, +z up); the root node turns them to glTF's +y up. The swing is
magnified to a share of the organ's length and slowed to `PERIOD` seconds; `extras` say by how much.
"""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult

SWING = 0.16
"""Largest displacement shown, as a share of the organ's length."""
PERIOD = 2.0
"""Seconds of one swing on the screen."""
KEYFRAMES = 25
Z_UP_TO_Y_UP = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
FLOAT, POINTS, VERTICES = 5126, 0, 34962
LOWEST, MIDDLE, HIGHEST = np.array([[0, 34, 78], [124, 123, 120], [254, 232, 56]]) / 255
"""Ends and middle of cividis, which a colour-blind reader and a grey print keep in order."""


@dataclass(slots=True)
class Buffer:
    """The binary part of a file, and the views and accessors that name its pieces."""

    content: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(self, values: Float[np.ndarray, "..."], kind: str, target: int | None = None) -> int:
        """Append an array as float32; returns the accessor's index."""
        flat = np.ascontiguousarray(values, dtype="<f4")
        rows = flat.reshape(len(flat), -1)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.content), "byteLength": flat.nbytes}
        self.views.append(view | ({"target": target} if target else {}))
        self.content += flat.tobytes()
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": FLOAT,
                "count": len(flat),
                "type": kind,
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1


def write_gltf(organ: OrganResult, k: int, path: Path) -> Path:
    """Write mode `k` (counted from 0) of the organ as a .glb."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(glb(organ, k))
    return path


def glb(organ: OrganResult, k: int) -> bytes:
    """The mode as the bytes of a .glb."""
    positions = organ.displacement.sensors.positions
    motion = organ.model.mode_shapes[:, :, k] @ organ.displacement.directions
    magnification = _magnification(positions, motion)
    instants = np.linspace(0, PERIOD, KEYFRAMES)
    buffer = Buffer()
    place = buffer.add(positions, "VEC3", VERTICES)
    color = buffer.add(signed_colors(motion), "VEC3", VERTICES)
    swing = buffer.add(magnification * motion, "VEC3", VERTICES)
    when = buffer.add(instants, "SCALAR")
    weight = buffer.add(np.sin(2 * np.pi * instants / PERIOD), "SCALAR")
    frequency = float(organ.model.frequencies[k])
    name = f"{organ.organ} mode {k}"
    primitive = {
        "attributes": {"POSITION": place, "COLOR_0": color},
        "mode": POINTS,
        "targets": [{"POSITION": swing}],
    }
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    document = {
        "asset": {"version": "2.0", "generator": "nerfmodal"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0, "rotation": [float(part) for part in Z_UP_TO_Y_UP]}],
        "meshes": [{"name": name, "primitives": [primitive], "weights": [0.0]}],
        "animations": [{"name": name, "samplers": [{"input": when, "output": weight}], "channels": [channel]}],
        "buffers": [{"byteLength": len(buffer.content)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
        "extras": {
            "natural_frequency_hz": frequency,
            "metres_per_weight": magnification,
            "slowed": PERIOD * frequency,
        },
    }
    return _chunks(document, bytes(buffer.content))


def signed_colors(motion: Float[np.ndarray, "sensors 3"]) -> Float[np.ndarray, "sensors 3"]:
    """Colour by displacement along the main direction of the motion, from -1 to 1 of its largest."""
    direction = np.linalg.svd(motion, full_matrices=False)[2][0]
    signed = motion @ direction
    signed = signed / max(float(np.abs(signed).max()), 1e-12)
    channels = zip(LOWEST, MIDDLE, HIGHEST, strict=True)
    return np.stack([np.interp(signed, (-1, 0, 1), channel) for channel in channels], axis=1)


def _magnification(positions: Float[np.ndarray, "sensors 3"], motion: Float[np.ndarray, "sensors 3"]) -> float:
    length = float(np.linalg.norm(np.ptp(positions, axis=0)))
    return SWING * length / max(float(np.linalg.norm(motion, axis=1).max()), 1e-12)


def _chunks(document: dict[str, Any], content: bytes) -> bytes:
    """The container: a header, then JSON padded with spaces and the buffer padded with zeros to four bytes."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    content += b"\0" * (-len(content) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(content), b"BIN\0") + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
