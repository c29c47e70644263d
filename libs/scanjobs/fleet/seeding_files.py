"""The files of a demonstration plant's scans, as an identification would have published them: modes.json and shapes."""

import io
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from scanjobs.artifacts import ArtifactStore, Stored
from scanjobs.monitoring.simulated import Kind, Life

AT_ONCE: Final = 16
SHAPES: Final = 3
"""Versions of each shape of a plant: scans of one mode do not see quite the same."""
FRAME_RATE_HZ: Final = 30.0
FRAMES: Final = 240


@dataclass(frozen=True, slots=True)
class Pot:
    """One plant of the demonstration: what it is called, and what becomes of it."""

    number: int
    treatment: str
    life: Life
    failed: np.ndarray
    dry_from: float | None
    again_from: float | None

    @property
    def id(self) -> str:
        return f"demo-{self.number:03d}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A scan with every file: its specification, and by role the files that its last step made and those before it."""

    spec: dict[str, Any]
    frames: int
    results: Mapping[str, Path]
    beside: Mapping[str, Path]


Draw = Callable[[Pot, Path], Drawn]
"""Computes the newest scan of a pot, with its files under a folder."""


def put_all(artifacts: ArtifactStore, files: Mapping[str, Path]) -> dict[str, Stored]:
    """Files brought into the store, by role."""
    return {role: artifacts.put(path) for role, path in files.items()}


class Files:
    """The files of a plant's scans in the store: shapes in a few versions, and a modes.json for each scan."""

    def __init__(self, artifacts: ArtifactStore, pot: Pot, rng: np.random.Generator) -> None:
        self._pot = pot
        with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE, "seed") as pool:
            self._artifacts, self._folder, self._pool = artifacts, Path(folder), pool
            self._shapes = self._put([_shape(pot, mode, rng) for _ in range(SHAPES) for mode in range(3)])
            documents = [_document(pot, k) for k in range(len(pot.life.at))]
            self._documents = self._put(documents)

    def of_scan(self, k: int) -> dict[str, Stored]:
        """Role → file."""
        modes = self._pot.life.frequencies.shape[1]
        first = (k % SHAPES) * modes
        shapes = {name: self._shapes[first + mode] for mode, name in enumerate(_shape_names())}
        return {"modes.json": self._documents[k]} | shapes

    def _put(self, contents: Sequence[bytes]) -> list[Stored]:
        def one(numbered: tuple[int, bytes]) -> Stored:
            path = self._folder / f"{len(numbered[1])}-{numbered[0]}"
            path.write_bytes(numbered[1])
            return self._artifacts.put(path)

        return list(self._pool.map(one, enumerate(contents)))


def _shape_names() -> list[str]:
    organs = Kind().organs
    return [f"shapes/{organ}_{organs[:k].count(organ)}.npz" for k, organ in enumerate(organs)]


def _shape(pot: Pot, mode: int, rng: np.random.Generator) -> bytes:
    """A bending shape on a small grid of sensors: first or second mode of a leaf, first of the trunk."""
    along = np.linspace(0.0, 1.0, 20)
    place = np.random.default_rng([pot.number, mode < 2])
    length = place.uniform(0.8, 1.1)
    if mode < 2:
        s, across = (grid.ravel() for grid in np.meshgrid(along, np.linspace(-0.06, 0.06, 4), indexing="ij"))
        positions = np.column_stack([length * s, across, 1.4 - 0.5 * s**2])
        bend = s**2 if mode == 0 else s**2 * (0.83 - s)
        directions = np.array([[0.0, 0.0, 1.0]])
    else:
        positions = np.column_stack([0.05 * np.ones(20), np.zeros(20), 1.4 * along])
        bend, directions = along**2, np.array([[1.0, 0.0, 0.0]])
    shape = (bend / np.abs(bend).max() + rng.normal(0.0, 0.02, len(bend)))[:, None]
    buffer = io.BytesIO()
    np.savez_compressed(buffer, positions=positions, shape=shape / np.abs(shape).max(), directions=directions)
    return buffer.getvalue()


def _document(pot: Pot, k: int) -> bytes:
    """The modes.json of a scan."""
    organs: dict[str, list[dict[str, Any]]] = {name: [] for name in dict.fromkeys(Kind().organs)}
    for mode, (organ, shape) in enumerate(zip(Kind().organs, _shape_names(), strict=True)):
        frequency = float(pot.life.frequencies[k, mode])
        if np.isfinite(frequency):
            organs[organ].append(_mode(pot, k, mode, len(organs[organ])) | {"shape": shape})
    document = {
        "name": pot.id,
        "frame_rate_hz": FRAME_RATE_HZ,
        "duration_s": FRAMES / FRAME_RATE_HZ,
        "frames": FRAMES,
        "excitation": "free_decay",
        "outcome": "OK",
        "message": "The result can be used.",
        "organs": [_organ(name, modes) for name, modes in organs.items()],
        "structure": [],
        "provenance": {"package_version": "demo", "simulated": True},
    }
    return json.dumps(document, ensure_ascii=False).encode()


def _organ(name: str, modes: list[dict[str, Any]]) -> dict[str, Any]:
    leaf = name.startswith("leaf")
    return {
        "name": name,
        "surface": "polynomial" if leaf else "cylinder",
        "sensors": 80 if leaf else 20,
        "frames_used": FRAMES,
        "outcome": "OK",
        "message": "The result can be used.",
        "modes": modes,
    }


def _mode(pot: Pot, k: int, mode: int, number: int) -> dict[str, Any]:
    rng = np.random.default_rng([pot.number, k, mode])
    frequency, std = float(pot.life.frequencies[k, mode]), float(pot.life.stds[k, mode])
    damping = float(pot.life.damping_ratios[k, mode])
    root = float(np.sqrt(1.0 - damping**2))
    return {
        "mode": number,
        "natural_frequency_hz": frequency,
        "natural_frequency_hz_std": std,
        "damped_frequency_hz": frequency * root,
        "damped_frequency_hz_std": std * root,
        "damping_ratio": damping,
        "damping_ratio_std": 0.1 * damping,
        "amplitude_m": round(float(rng.uniform(0.01, 0.05)), 4),
        "energy_share": round(float((0.7, 0.2, 0.9)[mode] + rng.normal(0.0, 0.03)), 3),
        "mpc": round(float(1.0 - abs(rng.normal(0.0, 0.01))), 4),
        "mac_between_methods": round(float(1.0 - abs(rng.normal(0.0, 0.01))), 4),
        "agreeing_methods": ["complexity_pursuit", "subspace"],
        "verdict": "doubtful" if rng.random() < 0.03 else "accepted",
        "reasons": [],
        "normalisation": "unit_max",
    }
