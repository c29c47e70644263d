"""What writing a result costs: 10,000 frames of 99,990 sensors, every file and every picture, in a process of its own.

`python -m benchmarks.exports` prints the table and writes `out/benchmarks/exports.json`.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from nerfmodal import export, figures
from nerfmodal.types import DisplacementMatrix, ModalModel, OrganResult, Reduction, ScanResult, SensorGrid

from benchmarks.rows import Row, print_and_write
from tests.fixtures.scans import FRAME_RATE, small_result, small_spec

FRAMES, SENSORS, TERMS, MODES = 10_000, 99_990, 21, 3
GIB, MIB = 2**30, 2**20


def wide_result() -> ScanResult:
    """A leaf whose displacement is a product of 21 coefficients and a smooth basis; its modes are the first three."""
    rng = np.random.default_rng(0)
    times = np.arange(FRAMES) / FRAME_RATE
    along, across = rng.uniform(0, 1, SENSORS), rng.uniform(-0.2, 0.2, SENSORS)
    powers = [(i, j) for i in range(6) for j in range(6 - i)]
    basis = np.stack([along**i * (5 * across) ** j for i, j in powers], axis=1)
    coefficients = 1e-4 * rng.normal(size=(FRAMES, TERMS))
    for term, frequency in enumerate((2.17, 4.83, 9.61), start=1):
        coefficients[:, term] += 0.02 * np.cos(2 * np.pi * frequency * times)
    positions = np.stack([along, across, 1.5 - 0.3 * along**2], axis=1)
    return replace(small_result(), organs=(_organ(times, coefficients, basis, positions),), times=times)


def _organ(times: np.ndarray, coefficients: np.ndarray, basis: np.ndarray, positions: np.ndarray) -> OrganResult:
    leaf = small_result().organs[0]
    shapes = basis[:, 1 : MODES + 1] / np.abs(basis[:, 1 : MODES + 1]).max(axis=0)
    model: ModalModel = replace(leaf.model, mode_shapes=shapes[:, None, :], coordinates=coefficients[:, 1 : MODES + 1])
    orthonormal, triangle = np.linalg.qr(basis)
    left, singular, right = np.linalg.svd(coefficients @ triangle.T, full_matrices=False)
    reduction = Reduction(
        components=orthonormal @ right[:MODES].T,
        scores=left[:, :MODES] * singular[:MODES],
        singular_values=singular,
        mean=np.zeros(SENSORS),
    )
    displacement = DisplacementMatrix(
        coefficients=coefficients,
        basis=basis,
        directions=np.array([[0.0, 0.0, 1.0]]),
        times=times,
        frame_rate=FRAME_RATE,
        sensors=SensorGrid(organ="leaf_0", positions=positions),
        valid=np.ones(len(times), dtype=bool),
    )
    return replace(leaf, displacement=displacement, reduction=reduction, model=model, opinions=())


def measure() -> dict[str, float]:
    """Draw and publish; seconds, GiB of the process at its peak beyond what the result takes, MiB written."""
    result, spec = wide_result(), small_spec()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        began = time.perf_counter()
        pictures = figures.draw(result, None, None, out / "figures")
        drawn = time.perf_counter()
        files = export.publish(spec, result, None, None, out, pictures=pictures)
        ended = time.perf_counter()
        written = sum(path.stat().st_size for path in files)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "draw_s": drawn - began,
        "publish_s": ended - drawn,
        "peak_gib": peak * 1024 / GIB,
        "beyond_gib": (peak - before) * 1024 / GIB,
        "written_mib": written / MIB,
    }


def rows() -> Iterator[Row]:
    """The table, measured in a process that does nothing else."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.exports", "--measure"], check=True, capture_output=True, text=True
    )
    found = json.loads(done.stdout)
    wide = f"{FRAMES:,} frames x {SENSORS:,} sensors, {MODES} modes"
    yield Row(what=f"{wide}: peak memory of all exports", value=found["peak_gib"], unit="GiB", floor=1.0, aim=0.5)
    yield Row(what=f"{wide}: all exports", value=found["publish_s"], unit="s", floor=180, aim=60)
    yield Row(what=f"{wide}: all pictures and films", value=found["draw_s"], unit="s", floor=60, aim=20)
    yield Row(what=f"{wide}: written", value=found["written_mib"], unit="MiB", floor=1024, aim=512)


def main() -> None:
    """Print the table and write it."""
    if sys.argv[1:] == ["--measure"]:
        print(json.dumps(measure()))
        return
    print_and_write(rows(), Path("out/benchmarks/exports.json"))


if __name__ == "__main__":
    main()
