"""The certificate as a document: every line that was tried, and what follows for each frequency.

SI units with a unit suffix on every key. `id` is the digest of all the rest but the date, `rig_digest` that of the
cameras and the frame rate: later scans of the same rig have the same. Version 1.
"""

import hashlib
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from nerfmodal import __version__
from nerfmodal.bounds import cramer_rao
from nerfmodal.certificate.target import AMPLITUDES, DAMPING_RATIO, Board
from nerfmodal.identify.comparison import ComparisonRow
from nerfmodal.preflight.certified import FORMAT, VERSION, certificate_id
from nerfmodal.types import Camera, Rig, TrueMode, Verdict

if TYPE_CHECKING:
    from nerfmodal.certificate.certify import Settings

Document = dict[str, Any]


def certificate_document(
    rig: Rig, board: Board, settings: "Settings", rows: Sequence[ComparisonRow], modes: Sequence[TrueMode]
) -> Document:
    """The whole certificate of `rig`, from the comparison of what was found with what was imposed."""
    lines = [_line(mode, rows, board) for mode in modes]
    frequencies = sorted({line["frequency_hz"] for line in lines})
    told = [_frequency([line for line in lines if line["frequency_hz"] == one], board, settings) for one in frequencies]
    noises = [one["noise_m"] for one in told if one["noise_m"] is not None]
    document = {
        "format": FORMAT,
        "format_version": VERSION,
        "rig_digest": rig_digest(rig, settings.frame_rate),
        "nerfmodal_version": __version__,
        "renderer": "preview",
        "frame_rate_hz": settings.frame_rate,
        "frames": settings.frames,
        "noise_counts": settings.noise_counts,
        "seed": settings.seed,
        "cameras": [_camera(camera) for camera in rig.cameras],
        "tried_width_px": board.rig.cameras[0].width,
        "tried_height_px": board.rig.cameras[0].height,
        "distance_m": board.distance,
        "footprint_m": board.footprint,
        "grain_m": board.grain,
        "noise_per_grain": float(np.median(noises)) / board.grain if noises else None,
        "false_modes": sum(row.truth_hz is None and row.verdict is Verdict.ACCEPTED for row in rows),
        "frequencies": told,
        "lines": lines,
    }
    return {"id": certificate_id(document), "created": datetime.now(UTC).isoformat(timespec="seconds")} | document


def rig_digest(rig: Rig, frame_rate: float) -> str:
    """SHA-256 of what makes a rig: its cameras to a micrometre and a thousandth of a pixel, and its frame rate.

    Neither the cameras' names nor their order count.
    """
    cameras = sorted(json.dumps(_camera(camera)) for camera in rig.cameras)
    return _digest({"cameras": cameras, "frame_rate_hz": round(frame_rate, 6)})


def _line(mode: TrueMode, rows: Sequence[ComparisonRow], board: Board) -> Document:
    amplitude = AMPLITUDES[int(mode.organ.split("_")[1])] * board.grain
    row = next((row for row in rows if row.organ == mode.organ and row.truth_hz == mode.frequency), None)
    found = row is not None and row.verdict is Verdict.ACCEPTED
    return {
        "patch": mode.organ,
        "shape": mode.name,
        "frequency_hz": mode.frequency,
        "amplitude_m": amplitude,
        "amplitude_px": amplitude / board.footprint,
        "detected": found,
        "verdict": None if row is None or row.verdict is None else row.verdict.value,
        "found_hz": None if row is None else row.found_hz,
        "found_hz_std": None if row is None else row.found_hz_std,
        "found_damping": None if row is None else row.found_damping,
        "mac": None if row is None else row.mac,
    }


def _frequency(lines: Sequence[Document], board: Board, settings: "Settings") -> Document:
    """Smallest amplitude from which all larger ones are detected; bias and spread, for an amplitude of one pixel.

    Errors shrink as amplitudes grow: each is weighted with its amplitude, so that all speak of the same noise.
    """
    frequency = lines[0]["frequency_hz"]
    seen = [line for line in lines if line["detected"]]
    weights = np.array([line["amplitude_m"] for line in seen])
    errors = np.array([line["found_hz"] - frequency for line in seen])
    damping = np.array([line["found_damping"] - DAMPING_RATIO for line in seen])
    smallest = _smallest(lines)
    times = np.arange(settings.frames) / settings.frame_rate
    bound, _ = cramer_rao(times, frequency, DAMPING_RATIO, 1.0)
    spread = _spread(errors, weights)
    return {
        "frequency_hz": frequency,
        "tried": len(lines),
        "detected": len(seen),
        "smallest_amplitude_m": smallest,
        "smallest_amplitude_px": None if smallest is None else smallest / board.footprint,
        "bias_hz": _bias(errors, weights),
        "spread_hz_at_one_px": None if spread is None else spread / board.footprint,
        "damping_bias": _bias(damping, weights),
        "damping_spread_at_one_px": None
        if spread is None
        else float(np.sqrt(np.mean((damping * weights) ** 2))) / board.footprint,
        "noise_m": None if spread is None else spread / bound,
    }


def _smallest(lines: Sequence[Document]) -> float | None:
    smallest = None
    for line in sorted(lines, key=lambda line: -line["amplitude_m"]):
        if not line["detected"]:
            break
        smallest = float(line["amplitude_m"])
    return smallest


def _bias(errors: np.ndarray, weights: np.ndarray) -> float | None:
    """Mean error, each weighted with the square of its amplitude: its information."""
    return float(np.average(errors, weights=weights**2)) if len(errors) else None


def _spread(errors: np.ndarray, weights: np.ndarray) -> float | None:
    """Root mean square of error times amplitude, Hz m."""
    return float(np.sqrt(np.mean((errors * weights) ** 2))) if len(errors) > 1 else None


def _camera(camera: Camera) -> Document:
    return {
        "width_px": camera.width,
        "height_px": camera.height,
        "focal_px": [round(camera.focal_x, 3), round(camera.focal_y, 3)],
        "center_px": [round(camera.center_x, 3), round(camera.center_y, 3)],
        "distortion": [round(value, 9) for value in camera.distortion],
        "model": camera.model,
        "camera_to_world": np.round(camera.camera_to_world, 6).tolist(),
    }


def _digest(document: Document) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
