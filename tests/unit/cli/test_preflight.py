"""`nerfmodal preflight`: what it prints, and its exit code."""

import json
from pathlib import Path

import numpy as np

from tests.unit.cli.conftest import SPEC, Call


def test_a_scan_that_cannot_be_is_3_with_the_key_and_the_remedy(call: Call, spec: Path) -> None:
    done = call("preflight", spec)
    assert done.exit_code == 3
    assert "verdict: refuse" in done.stdout
    assert "TOO_FEW_FRAMES  /source/frames: 3 frames hold no modes" in done.stdout


def test_a_good_scan_is_0_and_json_is_one_document(call: Call, spec: Path) -> None:
    spec.write_text(SPEC.replace("frames: 3", "frames: 90"))
    done = call("preflight", spec, "--json")
    assert done.exit_code == 0
    answer = json.loads(done.stdout)
    assert (answer["verdict"], answer["modes"][0]["organ"], answer["modes"][0]["found"]) == ("ok", "trunk", "likely")


def test_clouds_are_opened_and_judged_by_the_modes_one_expects(call: Call, tmp_path: Path) -> None:
    frames = {f"frame_{k:04d}": np.zeros((5, 3)) + k for k in range(40)}
    np.savez(tmp_path / "clouds.npz", **frames, frame_rate_hz=20.0)
    (tmp_path / "clouds.yaml").write_text("source: {kind: clouds, path: clouds.npz}\n")
    done = call("preflight", "clouds.yaml", "--mode", "3:0.01:12", "--noise-mm", "1", "--json")
    answer = json.loads(done.stdout)
    assert (answer["record"]["frames"], answer["record"]["frame_rate_hz"]) == (40, 20.0)
    assert answer["modes"][0]["amplitude_to_noise"] == 12.0
    assert call("preflight", "clouds.yaml", "--mode", "9.5:0.01:12").exit_code == 3
    wrong = call("preflight", "clouds.yaml", "--mode", "fast")
    assert (wrong.exit_code, "HZ:DAMPING:MM" in wrong.stderr) == (3, True)
