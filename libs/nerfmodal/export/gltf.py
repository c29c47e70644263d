"""A mode as an animated picture in space: binary glTF 2.0, the shape as a morph target that swings.

The organ's skin (`geometry.skins`) in world coordinates (metres, +z up); the root node turns it to glTF's +y up. The
swing is magnified to a share of the organ's length and slowed to `PERIOD` seconds; `extras` say by how much. Colours
say the displacement and are shown without shading where a viewer knows KHR_materials_unlit.
"""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.geometry.skins import skin_of
from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult

SWING = 0.16
"""Largest displacement shown, as a share of the organ's length."""
PERIOD = 2.0
"""Seconds of one swing on the screen."""
KEYFRAMES = 25
Z_UP_TO_Y_UP = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
MOST_SENSORS = 100_000
UNSIGNED, FLOAT = 5125, 5126
POINTS, TRIANGLES = 0, 4
VERTICES, INDICES = 34962, 34963
UNLIT = {
    "extensions": {"KHR_materials_unlit": {}},
    "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
    "doubleSided": True,
}
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
        limits = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self._append(flat, {"componentType": FLOAT, "count": len(flat), "type": kind} | limits, target)

    def add_indices(self, triangles: Int[np.ndarray, "triangles 3"]) -> int:
        """Append corners of triangles as uint32; returns the accessor's index."""
        flat = np.ascontiguousarray(triangles.ravel(), dtype="<u4")
        return self._append(flat, {"componentType": UNSIGNED, "count": len(flat), "type": "SCALAR"}, INDICES)

    def _append(self, content: np.ndarray, accessor: dict[str, Any], target: int | None) -> int:
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.content), "byteLength": content.nbytes}
        self.views.append(view | ({"target": target} if target else {}))
        self.content += content.tobytes()
        self.accessors.append({"bufferView": len(self.views) - 1} | accessor)
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
    skin = skin_of(positions, organ.surface, most=MOST_SENSORS)
    buffer = Buffer()
    primitive: dict[str, Any] = {
        "attributes": {
            "POSITION": buffer.add(skin.vertices, "VEC3", VERTICES),
            "COLOR_0": buffer.add(signed_colors(motion)[skin.sensor], "VEC3", VERTICES),
        },
        "mode": POINTS,
        "material": 0,
        "targets": [{"POSITION": buffer.add(magnification * motion[skin.sensor], "VEC3", VERTICES)}],
    }
    if len(skin.triangles):
        primitive |= {"mode": TRIANGLES, "indices": buffer.add_indices(skin.triangles)}
    extras = {
        "natural_frequency_hz": float(organ.model.frequencies[k]),
        "metres_per_weight": magnification,
        "slowed": PERIOD * float(organ.model.frequencies[k]),
    }
    return _chunks(_document(f"{organ.organ} mode {k}", primitive, extras, buffer), bytes(buffer.content))


def _document(name: str, primitive: dict[str, Any], extras: dict[str, float], buffer: Buffer) -> dict[str, Any]:
    instants = np.linspace(0, PERIOD, KEYFRAMES)
    sampler = {
        "input": buffer.add(instants, "SCALAR"),
        "output": buffer.add(np.sin(2 * np.pi * instants / PERIOD), "SCALAR"),
    }
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    return {
        "asset": {"version": "2.0", "generator": "nerfmodal"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0, "rotation": [float(part) for part in Z_UP_TO_Y_UP]}],
        "meshes": [{"name": name, "primitives": [primitive], "weights": [0.0]}],
        "materials": [UNLIT],
        "animations": [{"name": name, "samplers": [sampler], "channels": [channel]}],
        "buffers": [{"byteLength": len(buffer.content)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
        "extras": extras,
    }


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
