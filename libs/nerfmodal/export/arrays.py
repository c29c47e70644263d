"""Every displacement as one zarr store in a zip (`displacement.zarr.zip`), written piece by piece.

A group for every organ:

    displacement [frame, sensor, axis]   float32, metres; NaN in lost frames; chunked along frames and sensors
    coefficients [frame, term], basis [dof, term]   its exact factors D = C Bᵀ, float64; dof = sensor * axes + axis
    positions [sensor, xyz] m, directions [axis, xyz], times [frame] s, valid [frame]
    mode_shapes [sensor, axis, mode], coordinates [frame, mode] m, frequencies [mode] Hz, damping_ratios [mode]

`D` of 10,000 frames and 99,990 sensors is 4 GB, which nobody asked for: beyond `MOST_BYTES` an organ's `displacement`
keeps an even choice of its sensors, named in `displacement_sensors`; the factors are always whole. zarr format 3.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.storage import ZipStore

from nerfmodal.io import atomic_write
from nerfmodal.types import DisplacementMatrix, OrganResult, ScanResult

MOST_BYTES = 1 << 28
"""Of one organ's displacement before compression."""
CHUNK = (256, 1024)
"""Frames and sensors of a chunk: 1 MiB for one axis."""
SLAB = (256, 8192)
"""Frames and sensors in memory at once, whole chunks: 16 MiB for one axis."""


def write_displacement(result: ScanResult, path: Path, *, most_bytes: int = MOST_BYTES) -> Path:
    """Write the store; `most_bytes` is the largest displacement that keeps all its sensors."""
    with atomic_write(path) as temporary:
        temporary.unlink()  # the store wants to make its file itself
        with ZipStore(temporary, mode="w") as store:
            root = zarr.create_group(store, attributes={"frame_rate_hz": result.frame_rate, "unit": "m"})
            for organ in result.organs:
                _write_organ(root, organ, most_bytes)
    return path


def sensors_within(displacement: DisplacementMatrix, most_bytes: int) -> np.ndarray:
    """Indices of the sensors that are written: all, or an even choice that fits."""
    count = len(displacement.sensors.positions)
    bytes_each = 4 * len(displacement.times) * len(displacement.directions)
    fitting = int(np.clip(most_bytes // max(bytes_each, 1), 1, max(count, 1)))
    return np.unique(np.linspace(0, count - 1, min(count, fitting)).round()).astype(int)


def slabs(displacement: DisplacementMatrix, sensors: np.ndarray) -> Iterator[tuple[int, int, np.ndarray]]:
    """D at `sensors` in pieces: first frame, first of `sensors`, and values (frames, sensors, axes) in metres."""
    axes = len(displacement.directions)
    for sensor in range(0, len(sensors), SLAB[1]):
        some = sensors[sensor : sensor + SLAB[1]]
        basis = displacement.basis[(axes * some[:, None] + np.arange(axes)).ravel()].T
        for frame in range(0, len(displacement.times), SLAB[0]):
            rows = displacement.coefficients[frame : frame + SLAB[0]] @ basis
            yield frame, sensor, rows.reshape(len(rows), len(some), axes)


def _write_organ(root: zarr.Group, organ: OrganResult, most_bytes: int) -> None:
    displacement, model = organ.displacement, organ.model
    group = root.create_group(organ.organ, attributes={"surface": organ.surface})
    _write_slabs(group, displacement, sensors_within(displacement, most_bytes))
    _add(group, "coefficients", displacement.coefficients, ("frame", "term"), "m")
    _add(group, "basis", displacement.basis, ("dof", "term"), "1")
    _add(group, "positions", displacement.sensors.positions, ("sensor", "xyz"), "m")
    _add(group, "directions", displacement.directions, ("axis", "xyz"), "1")
    _add(group, "times", displacement.times, ("frame",), "s")
    _add(group, "valid", displacement.valid, ("frame",), "1")
    _add(group, "mode_shapes", model.mode_shapes, ("sensor", "axis", "mode"), "1")
    _add(group, "coordinates", model.coordinates, ("frame", "mode"), "m")
    _add(group, "frequencies", model.frequencies, ("mode",), "Hz")
    _add(group, "damping_ratios", model.damping_ratios, ("mode",), "1")


def _write_slabs(group: zarr.Group, displacement: DisplacementMatrix, sensors: np.ndarray) -> None:
    shape = (len(displacement.times), len(sensors), len(displacement.directions))
    array = group.create_array(
        "displacement",
        shape=shape,
        dtype="float32",
        chunks=_chunks(shape),
        fill_value=np.nan,
        dimension_names=("frame", "sensor", "axis"),
        attributes={"unit": "m", "sensors": "displacement_sensors"},
    )
    for frame, sensor, values in slabs(displacement, sensors):
        frames, count = values.shape[:2]
        array[frame : frame + frames, sensor : sensor + count] = values.astype(np.float32)
    _add(group, "displacement_sensors", sensors, ("sensor",), "1")


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    limits = (*CHUNK, *shape[2:])
    return tuple(max(1, min(length, limit)) for length, limit in zip(shape, limits, strict=True))


def _add(group: zarr.Group, name: str, values: np.ndarray, dimensions: tuple[str, ...], unit: str) -> None:
    chunks: Any = tuple(max(1, min(length, 1 << 16)) for length in values.shape)
    array = group.create_array(
        name,
        shape=values.shape,
        dtype=values.dtype,
        chunks=chunks,
        dimension_names=dimensions,
        attributes={"unit": unit},
    )
    if values.size:
        array[:] = values
