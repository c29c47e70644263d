"""Long and wide: 10,000 frames of 99,990 sensors from surface coefficients to a result on disk, in bounded memory."""

import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from nerfmodal import io
from nerfmodal.identify import identify
from nerfmodal.spec import IdentificationSpec
from nerfmodal.types import DisplacementMatrix

from benchmarks.rows import Row
from tests.fixtures.ambient import FREQUENCIES, factored
from tests.fixtures.public_cases import scan_result

FRAMES, SENSORS, BLOCK = 10_000, 99_990, 100
GIB = 2**30


def wide_rows(_seeds: int) -> Iterator[Row]:
    """Peak memory of a process of its own that does nothing else."""
    done = subprocess.run([sys.executable, "-m", __name__], check=True, capture_output=True, text=True)
    peak, worst = map(float, done.stdout.split()[-2:])
    yield Row(what="10,000 frames x 99,990 sensors: peak memory", value=peak, unit="GiB", floor=1.0, aim=0.5)
    yield Row(what="10,000 frames x 99,990 sensors: frequency error", value=worst, unit="mHz", floor=1.0, aim=0.5)


def wide_record() -> DisplacementMatrix:
    """Five and a half minutes of three slowly decaying modes in 21 coefficients."""
    rng = np.random.default_rng(0)
    times = np.arange(FRAMES) / 30.0
    modes = [
        np.exp(-2e-4 * 2 * np.pi * frequency * times) * np.cos(2 * np.pi * frequency * times)
        for frequency in FREQUENCIES
    ]
    coefficients = 0.03 * np.stack(modes, axis=1) @ (0.1 * rng.normal(size=(3, 21)))
    coefficients += 1e-4 * rng.normal(size=coefficients.shape)
    unit = rng.uniform(-1, 1, size=(2, SENSORS))
    basis = np.stack([unit[0] ** i * unit[1] ** j for i in range(6) for j in range(6 - i)]).T
    return factored(coefficients - coefficients.mean(axis=0), basis)


def main() -> None:
    """Identify, write the result, write all displacements a block of frames at a time; print the peak in GiB."""
    displacement = wide_record()
    organ = identify(displacement, IdentificationSpec(), seed=0)
    with tempfile.TemporaryDirectory() as folder:
        io.write_result(Path(folder) / "result.npz", scan_result((organ,), displacement.times))
        with (Path(folder) / "block.f32").open("wb") as file:
            for first in range(0, FRAMES, BLOCK):
                file.seek(0)  # every block in the place of the one before: four gigabytes would only fill the disk
                file.write(displacement.of_frames(first, first + BLOCK).astype(np.float32).tobytes())
    worst = max(np.abs(organ.model.frequencies - frequency).min() for frequency in FREQUENCIES)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / GIB, 1e3 * worst)


if __name__ == "__main__":
    main()
