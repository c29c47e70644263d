"""`compare` says which modes are one, how far apart they are in their own deviations, and what it cannot compare."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io
from nerfmodal.identify.comparison import compare, compare_results, modes_as_truth
from nerfmodal.types import OrganResult, ScanResult

from tests.fixtures.scans import small_result
from tests.unit.cli.conftest import Call

RESULT = small_result()
LEAF, TRUNK = RESULT.organs


def shifted(organ: OrganResult, by_hz: float) -> OrganResult:
    return replace(organ, model=replace(organ.model, frequencies=organ.model.frequencies + by_hz))


def renamed(result: ScanResult, names: tuple[str, ...]) -> ScanResult:
    organs = tuple(replace(organ, organ=name) for organ, name in zip(result.organs, names, strict=True))
    return replace(result, organs=organs)


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    paths = {name: tmp_path / f"{name}.npz" for name in ("first", "second", "truth")}
    io.write_result(paths["first"], RESULT)
    io.write_result(paths["second"], replace(RESULT, organs=(shifted(LEAF, 0.01), TRUNK)))
    io.write_truth(paths["truth"], [mode for organ in RESULT.organs for mode in modes_as_truth(organ)])
    return paths


def test_distance_is_counted_in_deviations_of_the_difference():
    rows = compare_results(RESULT, replace(RESULT, organs=(shifted(LEAF, 0.01), TRUNK)))
    assert rows[0].frequency_deviations == pytest.approx(0.01 / np.hypot(0.003, 0.003))
    assert rows[0].frequency_error == pytest.approx(0.01 / 2.17)
    assert rows[0].damping_deviations == 0


def test_a_truth_has_no_deviation_of_its_own():
    rows = compare(replace(RESULT, organs=(shifted(LEAF, 0.01),)), modes_as_truth(LEAF))
    assert rows[0].frequency_deviations == pytest.approx(0.01 / 0.003)
    assert rows[0].truth_hz_std == 0


def test_an_unknown_deviation_gives_no_distance():
    unknown = replace(LEAF, model=replace(LEAF.model, frequency_stds=np.full(3, np.nan)))
    (row, *_) = compare(replace(RESULT, organs=(unknown,)), modes_as_truth(LEAF))
    assert (row.found_hz_std, row.frequency_deviations) == (None, None)


def test_organs_of_other_names_are_paired_by_their_place():
    rows = compare_results(RESULT, renamed(RESULT, ("sheet", "rod")))
    assert [row.organ for row in rows] == ["sheet"] * 3 + ["rod"]
    assert all(row.mac == pytest.approx(1.0) for row in rows)


def test_organs_elsewhere_stay_alone():
    grid = replace(LEAF.displacement.sensors, positions=LEAF.displacement.sensors.positions + [5.0, 0, 0])
    away = replace(LEAF, organ="sheet", displacement=replace(LEAF.displacement, sensors=grid))
    rows = compare_results(replace(RESULT, organs=(LEAF,)), replace(RESULT, organs=(away,)))
    assert [(row.truth_hz is None, row.found_hz is None) for row in rows] == [(True, False)] * 3 + [(False, True)] * 3


def test_many_sensors_have_the_mac_of_an_even_choice_of_them():
    """Twenty copies of the leaf's sensors: the choice of 2,000 of 18,000 says the same."""
    grid = replace(LEAF.displacement.sensors, positions=np.tile(LEAF.displacement.sensors.positions, (20, 1)))
    displacement = replace(LEAF.displacement, sensors=grid, basis=np.tile(LEAF.displacement.basis, (20, 1)))
    many = replace(
        LEAF,
        displacement=displacement,
        model=replace(LEAF.model, mode_shapes=np.tile(LEAF.model.mode_shapes, (20, 1, 1))),
    )
    rows = compare(replace(RESULT, organs=(many,)), modes_as_truth(LEAF))
    assert min(row.mac for row in rows) > 0.999


def test_two_results_are_printed_as_a_and_b_with_their_distance(call: Call, files: dict[str, Path]):
    printed = call("compare", files["first"], files["second"]).stdout
    assert "A Hz" in printed
    assert "deviations" in printed
    assert "2.4" in printed  # 0.01 Hz over √2 · 0.003 Hz
    assert "truth" not in printed


def test_result_and_truth_may_come_in_either_order(call: Call, files: dict[str, Path]):
    there = json.loads(call("compare", files["second"], files["truth"], "--json").stdout)
    back = json.loads(call("compare", files["truth"], files["second"], "--json").stdout)
    assert there == back
    assert there[0]["truth_hz"] == pytest.approx(2.17)
    assert there[0]["found_hz"] == pytest.approx(2.18)


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("kind", ["two truths", "arrays", "text", "cut off", "empty", "absent", "one array"])
def test_what_cannot_be_compared_names_the_file_and_the_remedy(
    kind: str, call: Call, files: dict[str, Path], tmp_path: Path
):
    other = tmp_path / "other.npz"
    if kind == "two truths":
        other, files["first"] = files["truth"], files["truth"]
    elif kind == "arrays":
        np.savez(other, frame_0000=np.zeros((4, 3)))
    elif kind == "one array":
        other = tmp_path / "other.npy"
        np.save(other, np.zeros(3))
    elif kind != "absent":
        contents = {"text": b"frequency 2.17", "cut off": files["second"].read_bytes()[:2000], "empty": b""}
        written(other, contents[kind])
    ended = call("compare", files["first"], other)
    assert ended.exit_code == 3
    assert other.name in ended.stderr
    assert "result.npz" in ended.stderr
