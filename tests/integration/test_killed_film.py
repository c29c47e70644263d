"""A simulation that is killed leaves whole pictures and no capture; done again, it gives the same film."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io
from nerfmodal.progress import Progress
from nerfmodal.spec import ScanSpec
from PIL import Image

from services.cli.captures import write_capture

SPEC = ScanSpec.model_validate(
    {
        "source": {
            "kind": "simulation",
            "structure": "tower",
            "frames": 12,
            "frame_rate_hz": 30,
            "motion": [{"organ": "mast", "shape": "bending_1", "frequency_hz": 1.9, "amplitude_m": 0.05}],
            "rig": {"cameras": 3, "width_px": 64, "height_px": 96},
            "renderer": "preview",
            "samples": 1,
            "depth_maps": True,
        }
    }
)
FILM = """
import sys
from pathlib import Path
from nerfmodal.spec import ScanSpec
from services.cli.captures import write_capture
write_capture(ScanSpec.model_validate_json(sys.argv[1]), Path(sys.argv[2]), report=lambda *_: None)
"""


def quiet(_step: str, _now: Progress) -> None:
    """Progress that nobody reads."""


def pictures_of(folder: Path) -> dict[str, np.ndarray]:
    found = sorted(path for path in folder.rglob("*.png") if not path.name.startswith("."))
    return {str(path.relative_to(folder)): np.asarray(Image.open(path)) for path in found}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    write_capture(SPEC, folder, report=quiet)
    return folder


def test_a_killed_film_leaves_no_half_picture(whole: Path, tmp_path: Path) -> None:
    child = subprocess.Popen([sys.executable, "-c", FILM, SPEC.model_dump_json(), str(tmp_path)])
    try:
        until = time.monotonic() + 60
        while not list(tmp_path.glob("images/frame_0001/*")) and child.poll() is None and time.monotonic() < until:
            time.sleep(0.002)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    left = pictures_of(tmp_path)
    every = pictures_of(whole)
    assert 3 <= len(left) < len(every)
    for name, picture in left.items():
        assert np.array_equal(picture, every[name])
    for path in tmp_path.glob("depths/depth_*.npz"):
        assert len(io.read_depths(path)) == 3
    assert not (tmp_path / "transforms.json").exists()
    assert not (tmp_path / "truth.npz").exists()
    write_capture(SPEC, tmp_path, report=quiet)
    assert pictures_of(tmp_path).keys() == every.keys()


def test_a_film_has_its_truth_beside_it(whole: Path) -> None:
    summary = json.loads((whole / "truth.json").read_text())
    assert [(row["organ"], row["name"], row["frequency_hz"]) for row in summary] == [("mast", "bending_1", 1.9)]
    assert io.read_positions(whole / "truth.npz").shape[0] == 12
    assert len(list(whole.glob("depths/depth_*.npz"))) == 12
