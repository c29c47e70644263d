"""A mode as binary glTF: read back by a plain reader here, by pygltflib and by Khronos' validator."""

import json
import os
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from nerfmodal.export import write_gltf
from nerfmodal.export.gltf import PERIOD, SWING, glb
from nerfmodal.geometry.skins import RADIUS, SIDES

from tests.fixtures.scans import small_result

RESULT = small_result()
LEAF, TRUNK = RESULT.organs
ROOT = Path(__file__).parents[3]


def parts_of(content: bytes) -> tuple[dict, bytes]:
    """A plain reader of the container."""
    magic, version, length = struct.unpack_from("<4sII", content)
    size, kind = struct.unpack_from("<I4s", content, 12)
    binary_size, binary_kind = struct.unpack_from("<I4s", content, 20 + size)
    assert (magic, version, length, kind, binary_kind) == (b"glTF", 2, len(content), b"JSON", b"BIN\0")
    assert 28 + size + binary_size == length
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def array_of(document: dict, binary: bytes, index: int) -> np.ndarray:
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    piece = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    kind = {5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
    values = np.frombuffer(piece, kind).reshape(accessor["count"], -1)
    if "min" in accessor:
        np.testing.assert_allclose(values.min(axis=0), accessor["min"], rtol=1e-6)
        np.testing.assert_allclose(values.max(axis=0), accessor["max"], rtol=1e-6)
    return values


def primitive_of(document: dict) -> dict:
    (primitive,) = document["meshes"][0]["primitives"]
    return primitive


def test_animation_swings_the_shape_and_closes():
    document, binary = parts_of(glb(TRUNK, 0))
    swing = array_of(document, binary, primitive_of(document)["targets"][0]["POSITION"])
    sampler = document["animations"][0]["samplers"][0]
    weights = array_of(document, binary, sampler["output"])[:, 0]
    length = np.linalg.norm(np.ptp(TRUNK.displacement.sensors.positions, axis=0))
    assert np.linalg.norm(swing, axis=1).max() == pytest.approx(SWING * length, rel=1e-5)
    assert (weights.min(), weights.max()) == pytest.approx((-1, 1), abs=0.01)
    assert weights[0] == pytest.approx(weights[-1], abs=1e-6)
    assert array_of(document, binary, sampler["input"])[-1, 0] == pytest.approx(PERIOD)


def test_a_trunk_is_a_tube_whose_rings_move_with_their_sensors():
    document, binary = parts_of(glb(TRUNK, 0))
    primitive = primitive_of(document)
    rest = array_of(document, binary, primitive["attributes"]["POSITION"]).reshape(-1, SIDES, 3)
    swing = array_of(document, binary, primitive["targets"][0]["POSITION"]).reshape(-1, SIDES, 3)
    centres = rest.mean(axis=1)
    np.testing.assert_allclose(centres[:, :2], 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(rest - centres[:, None], axis=2), RADIUS * 2.5, rtol=1e-4)
    np.testing.assert_allclose(swing, np.broadcast_to(swing[:, :1], swing.shape))
    expected = (centres[:, 2] / 2.5) ** 2 * document["extras"]["metres_per_weight"]
    np.testing.assert_allclose(swing[:, 0, 0], expected, atol=1e-5)


def test_a_leaf_keeps_its_sensors_and_its_triangles_join_them():
    document, binary = parts_of(glb(LEAF, 2))
    primitive = primitive_of(document)
    rest = array_of(document, binary, primitive["attributes"]["POSITION"])
    swing = array_of(document, binary, primitive["targets"][0]["POSITION"])
    corners = array_of(document, binary, primitive["indices"]).reshape(-1, 3)
    np.testing.assert_allclose(rest, LEAF.displacement.sensors.positions, atol=1e-6)
    np.testing.assert_allclose(
        swing[:, 2] / document["extras"]["metres_per_weight"], LEAF.model.mode_shapes[:, 0, 2], atol=1e-6
    )
    assert corners.max() == len(rest) - 1
    assert np.linalg.norm(np.diff(rest[corners], axis=1), axis=2).max() < 0.2


def test_root_turns_up_to_gltf_up():
    node = parts_of(glb(LEAF, 0))[0]["nodes"][0]
    x, y, z, w = node["rotation"]
    turned = trimesh.transformations.quaternion_matrix([w, x, y, z])[:3, :3] @ (0, 0, 1)
    np.testing.assert_allclose(turned, (0, 1, 0), atol=1e-12)


def test_pygltflib_reads_what_was_written(tmp_path: Path):
    pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed")
    path = write_gltf(LEAF, 0, tmp_path / "leaf_0_0.glb")
    read = pygltflib.GLTF2().load(str(path))
    assert read.animations[0].channels[0].target.path == "weights"
    assert read.accessors[0].count == len(LEAF.displacement.sensors.positions)
    assert len(read.binary_blob()) == read.buffers[0].byteLength


VALIDATE = """
const validator = require("gltf-validator"), fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
  .then(report => console.log(JSON.stringify({issues: report.issues, info: report.info})));
"""


def validated(path: Path) -> dict:
    """What Khronos' validator says of a file. Skips where node or the validator is absent."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    folders = [os.environ.get("NODE_PATH", ""), str(ROOT / ".venv" / "node_modules")]
    environment = os.environ | {"NODE_PATH": os.pathsep.join(filter(None, folders))}
    done = subprocess.run(
        [node, "-e", VALIDATE, str(path)], env=environment, capture_output=True, text=True, check=False
    )
    if "Cannot find module 'gltf-validator'" in done.stderr:
        pytest.skip("gltf-validator is not installed: npm install --no-save --prefix .venv gltf-validator")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def four_sensors_on_a_line():
    grid = replace(LEAF.displacement.sensors, positions=np.outer(np.arange(4.0), [1, 1, 0]))
    displacement = replace(LEAF.displacement, basis=LEAF.displacement.basis[:4], sensors=grid)
    model = replace(LEAF.model, mode_shapes=LEAF.model.mode_shapes[:4])
    return replace(LEAF, displacement=displacement, model=model)


@pytest.mark.parametrize("organ", [LEAF, TRUNK, four_sensors_on_a_line()], ids=["leaf", "trunk", "points"])
def test_the_official_validator_finds_nothing(organ, tmp_path: Path):
    report = validated(write_gltf(organ, 0, tmp_path / "mode.glb"))
    assert report["issues"]["messages"] == []
    assert report["info"]["hasMorphTargets"]
    assert report["info"]["animationCount"] == 1
