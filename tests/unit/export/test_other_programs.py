"""Files for other programs hold the same modes: read back by each format's own library and by a plain reader here."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from nerfmodal.export import write_gltf, write_uff, write_vectors
from nerfmodal.export.gltf import PERIOD, SWING, glb

from tests.fixtures.scans import LEAF_FREQUENCIES, TRUNK_FREQUENCY, small_result

RESULT = small_result()
LEAF, TRUNK = RESULT.organs


@pytest.fixture(scope="module")
def uff(tmp_path_factory) -> Path:
    return write_uff(RESULT, "small", tmp_path_factory.mktemp("uff") / "modes.uff")


def sets_of(path: Path) -> list[tuple[int, list[str]]]:
    """A plain reader: the number and the lines of every data set."""
    pieces = [[]]
    for line in path.read_text(encoding="ascii").splitlines():
        if line == "    -1":
            pieces.append([])
        else:
            pieces[-1].append(line)
    return [(int(lines[0]), lines[1:]) for lines in pieces if lines]


def test_universal_file_has_its_sets_in_order(uff: Path):
    kinds = [kind for kind, _ in sets_of(uff)]
    assert kinds == [151, 164, 15] + [55, 58] * 4
    assert max(len(line) for _, lines in sets_of(uff) for line in lines) <= 80


def test_plain_reader_finds_shapes_of_the_trunk_at_its_own_nodes(uff: Path):
    sets = sets_of(uff)
    lines = [lines for kind, lines in sets if kind == 55][-1]
    assert float(lines[7][:13]) == pytest.approx(TRUNK_FREQUENCY)
    numbers = [int(line) for line in lines[8::2]]
    vectors = np.array([[float(line[at : at + 13]) for at in (0, 13, 26)] for line in lines[9::2]])
    first = len(LEAF.displacement.sensors.positions) + 1
    assert numbers == list(range(first, first + 500))
    np.testing.assert_allclose(vectors[:, :2], TRUNK.model.mode_shapes[:, :, 0], rtol=1e-5, atol=1e-12)


def test_pyuff_reads_what_was_written(uff: Path):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed")
    sets = pyuff.UFF(str(uff)).read_sets()
    nodes = next(part for part in sets if part["type"] == 15)
    shapes = [part for part in sets if part["type"] == 55]
    histories = [part for part in sets if part["type"] == 58]
    np.testing.assert_allclose(nodes["z"][:900], LEAF.displacement.sensors.positions[:, 2], atol=1e-5)
    assert [part["freq"] for part in shapes[:3]] == pytest.approx(LEAF_FREQUENCIES.tolist(), rel=1e-5)
    np.testing.assert_allclose(shapes[2]["r3"], LEAF.model.mode_shapes[:, 0, 2], atol=1e-5)
    seen = LEAF.displacement.valid
    np.testing.assert_allclose(histories[0]["data"], LEAF.model.coordinates[seen, 0], atol=1e-12)
    np.testing.assert_allclose(histories[0]["x"], LEAF.displacement.times[seen], atol=1e-5)


def test_record_without_losses_is_evenly_spaced(tmp_path: Path):
    whole = replace(TRUNK.displacement, valid=np.ones_like(TRUNK.displacement.valid))
    path = write_uff(replace(RESULT, organs=(replace(TRUNK, displacement=whole),)), "whole", tmp_path / "whole.uff")
    form = sets_of(path)[-1][1][6]
    assert [int(form[at : at + 10]) for at in (10, 20)] == [90, 1]
    assert float(form[43:56]) == pytest.approx(1 / 30, rel=1e-4)


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
    values = np.frombuffer(piece, "<f4").reshape(accessor["count"], -1)
    np.testing.assert_allclose(values.min(axis=0), accessor["min"], rtol=1e-6)
    np.testing.assert_allclose(values.max(axis=0), accessor["max"], rtol=1e-6)
    return values


def test_animation_swings_the_shape_and_closes():
    document, binary = parts_of(glb(TRUNK, 0))
    (primitive,) = document["meshes"][0]["primitives"]
    swing = array_of(document, binary, primitive["targets"][0]["POSITION"])
    rest = array_of(document, binary, primitive["attributes"]["POSITION"])
    sampler = document["animations"][0]["samplers"][0]
    weights = array_of(document, binary, sampler["output"])[:, 0]
    length = np.linalg.norm(np.ptp(TRUNK.displacement.sensors.positions, axis=0))
    np.testing.assert_allclose(rest, TRUNK.displacement.sensors.positions, atol=1e-6)
    assert np.linalg.norm(swing, axis=1).max() == pytest.approx(SWING * length, rel=1e-5)
    assert (weights.min(), weights.max()) == pytest.approx((-1, 1), abs=0.01)
    assert weights[0] == pytest.approx(weights[-1], abs=1e-6)
    assert array_of(document, binary, sampler["input"])[-1, 0] == pytest.approx(PERIOD)


def test_shape_in_the_animation_is_the_mode_times_the_stated_magnification():
    document, binary = parts_of(glb(LEAF, 2))
    target = document["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    swing = array_of(document, binary, target) / document["extras"]["metres_per_weight"]
    np.testing.assert_allclose(swing[:, 2], LEAF.model.mode_shapes[:, 0, 2], atol=1e-6)


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


def test_vectors_are_read_by_trimesh(tmp_path: Path):
    path = write_vectors(LEAF, 0, tmp_path / "leaf_0_0.ply")
    cloud = trimesh.load(path)
    np.testing.assert_allclose(cloud.vertices, LEAF.displacement.sensors.positions, atol=1e-6)
    vertices = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(vertices["dz"], LEAF.model.mode_shapes[:, 0, 0], atol=1e-6)
