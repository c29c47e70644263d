"""Scores of a result whose truth is known in closed form, and the document and page that they become."""

import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal.figures import draw
from nerfmodal.reproduction import experiment_document, goals_of, page, paper_figures, score
from nerfmodal.reproduction.scores import active_eigenvalues, score_organ
from nerfmodal.types import OrganResult, TrueMode

from tests.fixtures.scans import small_frame, small_result, small_spec


def truth_of(organ: OrganResult, modes: tuple[int, ...]) -> list[TrueMode]:
    """The organ's own modes as if they had been imposed."""
    model, directions = organ.model, organ.displacement.directions
    return [
        TrueMode(
            organ=organ.organ,
            name=f"bending_{k + 1}",
            frequency=float(model.frequencies[k]),
            damping_ratio=float(model.damping_ratios[k]),
            points=organ.displacement.sensors.positions,
            shape=model.mode_shapes[:, :, k] @ directions,
            coordinates=model.coordinates[:, k],
        )
        for k in modes
    ]


def test_displacement_is_compared_at_all_sensors_and_frames():
    leaf, trunk = small_result().organs
    truth = truth_of(leaf, (0, 1, 2))
    exact = score_organ(leaf, truth)
    assert exact.displacement_error is not None
    assert exact.displacement_error < 0.06  # what the fixture adds to its modes is noise of 0.4 mm
    halved = [replace(mode, coordinates=0.5 * mode.coordinates) for mode in truth]
    assert score_organ(leaf, halved).displacement_error == pytest.approx(1.0, abs=0.06)
    assert score_organ(trunk, truth_of(trunk, (0,))).true_active == 1


def test_an_organ_that_was_lost_has_no_error():
    leaf = small_result().organs[0]
    lost = replace(leaf, displacement=replace(leaf.displacement, valid=np.zeros(90, dtype=bool)))
    assert score_organ(lost, truth_of(leaf, (0,))).displacement_error is None


def test_active_eigenvalues_are_those_of_a_hundredth_of_the_largest():
    assert active_eigenvalues(np.array([100.0, 1.0, 0.99])) == 2
    assert active_eigenvalues(np.zeros(3)) == 0


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    result, spec = small_result(), small_spec()
    truth = [mode for organ in result.organs for mode in truth_of(organ, (0,))]
    modes, organs = score(result, truth)
    experiment = experiment_document(spec, result, modes, organs, 90.0)
    machine = {"cores": 2, "memory_gib": 8.0, "python": "3.11"}
    return {
        "command": "nerfmodal reproduce paper",
        "version": "0",
        "machine": machine,
        "seconds": 90.0,
        "resumed": False,
        "experiments": [experiment],
    }


def test_modes_that_nobody_imposed_are_kept_and_only_accepted_ones_count_against_it(stored: dict[str, Any]):
    [experiment] = stored["experiments"]
    leaf = [row for row in experiment["modes"] if row["organ"] == "leaf_0"]
    assert [row["truth_hz"] is None for row in leaf] == [False, True, True]
    goals = {goal["what"]: goal for goal in goals_of(experiment)}
    assert goals["accepted modes that are not in the truth"]["met"]
    wrong = copy.deepcopy(experiment)
    wrong["modes"][1]["verdict"] = "accepted"
    assert not {goal["what"]: goal["met"] for goal in goals_of(wrong)}["accepted modes that are not in the truth"]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"found_hz": 2.17 * 1.0051}, "largest error of a frequency"),
        ({"found_damping": 0.0151}, "largest error of a damping ratio"),
        ({"mac": 0.949}, "smallest MAC"),
        ({"verdict": "doubtful"}, "modes found and accepted"),
    ],
)
def test_each_goal_can_be_missed(stored: dict[str, Any], change: dict[str, Any], what: str):
    experiment = copy.deepcopy(stored["experiments"][0])
    assert all(goal["met"] for goal in goals_of(experiment))
    experiment["modes"][0] |= change
    assert [goal["what"] for goal in goals_of(experiment) if not goal["met"]] == [what]


def test_the_page_says_what_is_stored(stored: dict[str, Any]):
    text = page(json.loads(json.dumps(stored)))
    assert stored["command"] in text
    assert "| leaf_0 | bending_1 | – | 2.17 | 2.17000 ± 0.00300 |" in text
    assert "2 cores, 8 GiB memory" in text
    assert "1.5 minutes" in text


def test_the_papers_figures_are_named_as_in_the_paper(tmp_path: Path):
    result = replace(small_result(), organs=small_result().organs[1:])
    draw(result, None, None, tmp_path / "figures")
    files = paper_figures(result, small_frame(), tmp_path / "figures", tmp_path / "paper")
    numbers = [path.name.split("_")[1] for path in files if path.name.startswith("figure")]
    assert numbers == ["4", "5", "6", "7", "8", "9"]
    assert {path.suffix for path in files} == {".png", ".mp4", ".gif"}
    assert all(path.stat().st_size for path in files)
