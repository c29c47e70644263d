"""Universal files hold the same modes: read back by pyuff and by a plain reader here."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.export import write_uff
from nerfmodal.geometry.skins import edges, sheet_triangles

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
    assert kinds == [151, 164, 15, 82, 82] + [55, 58] * 4
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


def pen_strokes(lines: list[str]) -> list[list[int]]:
    """Runs of nodes joined by a line; a 0 lifts the pen."""
    numbers = [int(line[at : at + 10]) for line in lines[2:] for at in range(0, len(line), 10)]
    assert len(numbers) == int(lines[0][10:20])
    strokes = [[]]
    for number in numbers:
        if number:
            strokes[-1].append(number)
        else:
            strokes.append([])
    return [stroke for stroke in strokes if stroke]


def test_lines_join_neighbours_of_the_leaf_and_run_along_the_trunk(uff: Path):
    leaf, trunk = (pen_strokes(lines) for kind, lines in sets_of(uff) if kind == 82)
    joined = edges(sheet_triangles(LEAF.displacement.sensors.positions)) + 1
    assert sorted(map(tuple, leaf)) == sorted(map(tuple, joined.tolist()))
    (stroke,) = trunk
    assert stroke in (list(range(901, 1401)), list(range(1400, 900, -1)))


def test_pyuff_reads_what_was_written(uff: Path):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed")
    sets = pyuff.UFF(str(uff)).read_sets()
    nodes = next(part for part in sets if part["type"] == 15)
    shapes = [part for part in sets if part["type"] == 55]
    histories = [part for part in sets if part["type"] == 58]
    lines = [part for part in sets if part["type"] == 82]
    np.testing.assert_allclose(nodes["z"][:900], LEAF.displacement.sensors.positions[:, 2], atol=1e-5)
    assert [part["freq"] for part in shapes[:3]] == pytest.approx(LEAF_FREQUENCIES.tolist(), rel=1e-5)
    np.testing.assert_allclose(shapes[2]["r3"], LEAF.model.mode_shapes[:, 0, 2], atol=1e-5)
    seen = LEAF.displacement.valid
    np.testing.assert_allclose(histories[0]["data"], LEAF.model.coordinates[seen, 0], atol=1e-12)
    np.testing.assert_allclose(histories[0]["x"], LEAF.displacement.times[seen], atol=1e-5)
    assert {int(number) for number in lines[1]["nodes"]} == set(range(901, 1401))


def test_pyuff_reads_units_and_header(uff: Path):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed")
    sets = pyuff.UFF(str(uff)).read_sets()
    header, units = sets[0], sets[1]
    assert header["model_name"].strip() == "small"
    assert (units["units_code"], units["length"], units["temp_offset"]) == (1, 1.0, 273.15)


def test_record_without_losses_is_evenly_spaced(tmp_path: Path):
    whole = replace(TRUNK.displacement, valid=np.ones_like(TRUNK.displacement.valid))
    path = write_uff(replace(RESULT, organs=(replace(TRUNK, displacement=whole),)), "whole", tmp_path / "whole.uff")
    form = sets_of(path)[-1][1][6]
    assert [int(form[at : at + 10]) for at in (10, 20)] == [90, 1]
    assert float(form[43:56]) == pytest.approx(1 / 30, rel=1e-4)
