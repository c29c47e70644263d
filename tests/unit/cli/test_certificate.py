"""`nerfmodal certify`: which rigs a path means, and that a certificate's noise goes into preflight."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal.certificate import rig_digest
from nerfmodal.errors import InvalidInput
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.io.transforms import camera_entry
from nerfmodal.preflight.certified import FORMAT, VERSION, certificate_id, check_certificate
from nerfmodal.spec import RigSpec
from PIL import Image

from services.cli.certificate import read_certificate, rig_of
from tests.unit.cli.conftest import SPEC, Call

REST = {"cameras": [], "frame_rate_hz": 30.0}
RIG = RigSpec(cameras=4, width_px=32, height_px=24)


def test_the_same_rig_out_of_keys_a_specification_and_a_capture(tmp_path: Path) -> None:
    cameras = semi_spherical_rig(RIG).cameras
    keys, scan, folder = tmp_path / "rig.yaml", tmp_path / "scan.yaml", tmp_path / "capture"
    keys.write_text(RIG.model_dump_json())
    source = {"kind": "simulation", "frames": 3, "frame_rate_hz": 25, "motion": [], "rig": RIG.model_dump()}
    scan.write_text(json.dumps({"source": source}))
    write_capture(folder, [camera_entry(camera) for camera in cameras])
    found = {path: rig_of(path) for path in (keys, scan, folder, folder / "transforms.json")}
    assert {path: rate and round(rate, 6) for path, (_, rate) in found.items()} == {
        keys: None,
        scan: 25.0,
        folder: 20.0,
        folder / "transforms.json": 20.0,
    }
    assert {rig_digest(rig, 20.0) for rig, _ in found.values()} == {rig_digest(found[keys][0], 20.0)}


def write_capture(folder: Path, cameras: list[dict[str, Any]]) -> None:
    (folder / "images").mkdir(parents=True)
    frames = []
    for index in range(2):
        for camera in cameras:
            name = f"images/{camera['camera_id']}_{index}.png"
            Image.fromarray(np.zeros((24, 32, 3), dtype=np.uint8)).save(folder / name)
            frames.append(camera | {"file_path": name, "frame_index": index, "time_s": index / 20})
    (folder / "transforms.json").write_text(json.dumps({"frame_rate_hz": 20.0, "frames": frames}))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("cameras: 2", "/cameras"),
        ("[]", "Give a capture's folder"),
        ("source: {kind: clouds, path: x}", "has no cameras"),
    ],
)
def test_what_is_no_rig_is_refused_with_the_key(call: Call, tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    done = call("certify", "rig.yaml")
    assert done.exit_code == 3
    assert said in done.stderr


def test_a_rig_without_a_frame_rate_asks_for_it(call: Call, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(RIG.model_dump_json())
    done = call("certify", "rig.yaml")
    assert (done.exit_code, "--frame-rate" in done.stderr) == (3, True)


def test_preflight_takes_the_noise_of_a_certificate(call: Call, spec: Path, tmp_path: Path) -> None:
    spec.write_text(SPEC.replace("frames: 3", "frames: 90"))
    document = {"format": FORMAT, "format_version": VERSION, "rig_digest": "ab" * 32, **REST, "noise_per_grain": 0.12}
    document["id"] = certificate_id(document)
    (tmp_path / "certificate.json").write_text(json.dumps(document))
    plain, certified = (
        json.loads(call("preflight", spec, *more, "--json").stdout)
        for more in ((), ("--certificate", "certificate.json"))
    )
    assert certified["optics"]["noise_m"] == pytest.approx(2 * plain["optics"]["noise_m"])
    assert certified["optics"]["noise_basis"] == "the rig's certificate"
    assert certified["modes"][0]["frequency_std_hz"] == pytest.approx(2 * plain["modes"][0]["frequency_std_hz"])


def test_a_file_that_is_no_certificate_is_refused(tmp_path: Path) -> None:
    whole = {"format": FORMAT, "format_version": VERSION, "rig_digest": "ab" * 32, **REST}
    whole["id"] = certificate_id(whole)
    assert check_certificate(whole) == whole
    for text, said in (
        ("{", "cannot be read"),
        ("[]", "is no certificate"),
        (json.dumps(whole | {"format_version": 2}), "has version 2"),
        (json.dumps(whole | {"noise_per_grain": 0.01}), "was changed"),
    ):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(InvalidInput, match=said):
            read_certificate(tmp_path / "a.json")
