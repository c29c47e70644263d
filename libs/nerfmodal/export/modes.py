"""Modes as a document (`modes.json`) and as arrays (`shapes/<organ>_<k>.npz`).

SI units with a unit suffix on every key; modes count from 0 within their organ, sorted by frequency. A number that is
not known (a standard deviation that could not be computed, an agreement where one method alone saw the mode) is null.
"""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from nerfmodal.io import atomic_write
from nerfmodal.spec import ScanSpec
from nerfmodal.types import OrganResult, ScanResult, StructureMode

SHAPE_CONVENTION = {
    "normalisation": "unit_max",
    "sign": "largest component positive",
    "phase": "real: complex shapes are rotated to the real axis, mpc says how well that fits",
}


def modes_document(result: ScanResult, spec: ScanSpec) -> dict[str, Any]:
    """`modes.json` as a tree: every mode of every organ with its uncertainty and verdict, refused ones included."""
    return {
        "name": spec.name,
        "frame_rate_hz": result.frame_rate,
        "duration_s": duration(result),
        "frames": len(result.times),
        "excitation": result.excitation,
        "outcome": result.outcome.name,
        "message": result.outcome.value,
        "shape_convention": SHAPE_CONVENTION,
        "organs": [_organ(organ) for organ in result.organs],
        "structure": [_structure(mode, k) for k, mode in enumerate(result.structure)],
        "provenance": asdict(result.provenance),
    }


def duration(result: ScanResult) -> float:
    """Seconds that the record lasts: one frame interval for every frame."""
    if not len(result.times) or result.frame_rate <= 0:
        return 0.0
    return float(result.times[-1] - result.times[0]) + 1 / result.frame_rate


def write_modes(result: ScanResult, spec: ScanSpec, out: Path) -> tuple[Path, ...]:
    """Write `modes.json` and one file for each shape under `out`; returns what was written."""
    document = modes_document(result, spec)
    shapes = [_write_shape(organ, k, out) for organ in result.organs for k in range(len(organ.model.frequencies))]
    shapes += [_write_structure_shape(mode, k, out) for k, mode in enumerate(result.structure)]
    return (write_json(document, out / "modes.json"), *shapes)


def write_json(document: dict[str, Any], path: Path) -> Path:
    """Write a tree as strict JSON (no NaN)."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n")
    return path


def shape_key(organ: str, mode: int) -> str:
    """Where the shape of a mode (counted from 0) lies, relative to the results."""
    return f"shapes/{organ}_{mode}.npz"


def damped(frequency: float, frequency_std: float, damping: float, damping_std: float) -> tuple[float, float]:
    """Damped frequency fd = fn sqrt(1 - zeta²) and its standard deviation, Hz.

    First-order propagation; the estimates of frequency and damping of a damped sinusoid are uncorrelated.
    """
    root = math.sqrt(max(0.0, 1 - damping**2))
    slope = frequency * damping / root if root > 0 else 0.0
    return frequency * root, math.hypot(root * frequency_std, slope * damping_std)


def _organ(organ: OrganResult) -> dict[str, Any]:
    return {
        "name": organ.organ,
        "surface": organ.surface,
        "sensors": len(organ.displacement.sensors.positions),
        "frames_used": int(organ.displacement.valid.sum()),
        "outcome": organ.model.outcome.name,
        "message": organ.model.outcome.value,
        "modes": [_mode(organ, k) for k in range(len(organ.model.frequencies))],
    }


def _mode(organ: OrganResult, k: int) -> dict[str, Any]:
    model, quality = organ.model, organ.model.quality[k]
    frequency, frequency_std = float(model.frequencies[k]), float(model.frequency_stds[k])
    damping, damping_std = float(model.damping_ratios[k]), float(model.damping_stds[k])
    damped_frequency, damped_std = damped(frequency, frequency_std, damping, damping_std)
    return {
        "mode": k,
        "natural_frequency_hz": frequency,
        "natural_frequency_hz_std": _known(frequency_std),
        "damped_frequency_hz": damped_frequency,
        "damped_frequency_hz_std": _known(damped_std),
        "damping_ratio": damping,
        "damping_ratio_std": _known(damping_std),
        "amplitude_m": _amplitude(model.coordinates[organ.displacement.valid, k]),
        "energy_share": _known(quality.energy_share),
        "mpc": _known(quality.mpc),
        "mac_between_methods": None if quality.mac_between_methods is None else _known(quality.mac_between_methods),
        "agreeing_methods": list(quality.agreeing),
        "verdict": quality.verdict.value,
        "reasons": [reason.name for reason in quality.reasons],
        "normalisation": SHAPE_CONVENTION["normalisation"],
        "shape": shape_key(organ.organ, k),
    }


def _structure(mode: StructureMode, k: int) -> dict[str, Any]:
    """A motion that organs share: `amplitude` is relative to the largest, signed."""
    members = zip(mode.organs, mode.modes, mode.amplitudes, mode.phases, mode.coherences, strict=True)
    return {
        "mode": k,
        "natural_frequency_hz": mode.frequency,
        "natural_frequency_hz_std": _known(mode.frequency_std),
        "damping_ratio": mode.damping_ratio,
        "damping_ratio_std": _known(mode.damping_std),
        "organs": [
            {
                "name": name,
                "mode": index,
                "amplitude": float(amplitude),
                "phase_deg": math.degrees(phase),
                "coherence": float(coherence),
            }
            for name, index, amplitude, phase, coherence in members
        ],
        "verdict": mode.verdict.value,
        "shape": shape_key("structure", k),
    }


def _write_structure_shape(mode: StructureMode, k: int, out: Path) -> Path:
    path = out / shape_key("structure", k)
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, positions=mode.positions, shape=mode.shape)
    return path


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _amplitude(coordinate: np.ndarray) -> float | None:
    """Largest displacement anywhere on the organ during the record, metres (shapes have a largest component of 1)."""
    finite = coordinate[np.isfinite(coordinate)]
    return float(np.abs(finite).max()) if finite.size else None


def _write_shape(organ: OrganResult, k: int, out: Path) -> Path:
    path = out / shape_key(organ.organ, k)
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            positions=organ.displacement.sensors.positions,
            shape=organ.model.mode_shapes[:, :, k],
            directions=organ.displacement.directions,
        )
    return path
