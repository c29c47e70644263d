"""modes.json and the shape files say the same as the result they were written from."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.export import modes_document, write_modes
from nerfmodal.export.modes import damped

from tests.fixtures.scans import FRAME_RATE, FRAMES, small_result, small_spec

RESULT, SPEC = small_result(), small_spec()


def test_every_mode_is_listed_with_its_verdict_refused_ones_included():
    organs = modes_document(RESULT, SPEC)["organs"]
    assert [organ["name"] for organ in organs] == ["leaf_0", "trunk"]
    assert [mode["verdict"] for mode in organs[0]["modes"]] == ["accepted", "rejected", "doubtful"]
    assert organs[0]["modes"][1]["reasons"] == ["HARMONIC", "METHODS_DISAGREE"]
    assert organs[0]["modes"][1]["mac_between_methods"] is None


def test_record_is_described_as_filmed():
    document = modes_document(RESULT, SPEC)
    assert document["frame_rate_hz"] == FRAME_RATE
    assert document["duration_s"] == pytest.approx(FRAMES / FRAME_RATE)
    assert document["structure"] == []
    assert document["provenance"]["seed"] == 7


def test_damped_frequency_follows_its_definition():
    mode = modes_document(RESULT, SPEC)["organs"][0]["modes"][0]
    assert mode["damped_frequency_hz"] == pytest.approx(2.17 * math.sqrt(1 - 0.01**2))


@pytest.mark.parametrize(("frequency_std", "damping_std"), [(0.01, 1e-9), (1e-9, 0.01), (0.02, 0.005)])
def test_deviation_of_the_damped_frequency_agrees_with_drawing_it(frequency_std, damping_std):
    rng = np.random.default_rng(0)
    draws = rng.normal(5.0, frequency_std, 200_000) * np.sqrt(1 - rng.normal(0.1, damping_std, 200_000) ** 2)
    assert damped(5.0, frequency_std, 0.1, damping_std)[1] == pytest.approx(draws.std(), rel=0.01)


def test_what_is_not_known_is_null_and_the_json_stays_strict(tmp_path: Path):
    leaf = RESULT.organs[0]
    unknown = replace(leaf.model, frequency_stds=np.full(3, np.nan))
    write_modes(replace(RESULT, organs=(replace(leaf, model=unknown),)), SPEC, tmp_path)
    text = (tmp_path / "modes.json").read_text()
    assert "NaN" not in text
    assert json.loads(text)["organs"][0]["modes"][0]["natural_frequency_hz_std"] is None


def test_shape_files_hold_the_shapes_and_lie_where_the_document_says(tmp_path: Path):
    written = write_modes(RESULT, SPEC, tmp_path)
    mode = modes_document(RESULT, SPEC)["organs"][1]["modes"][0]
    trunk = RESULT.organs[1]
    assert tmp_path / mode["shape"] in written
    with np.load(tmp_path / mode["shape"]) as archive:
        np.testing.assert_array_equal(archive["shape"], trunk.model.mode_shapes[:, :, 0])
        np.testing.assert_array_equal(archive["positions"], trunk.displacement.sensors.positions)
        np.testing.assert_array_equal(archive["directions"], trunk.displacement.directions)


def test_amplitude_is_the_largest_displacement_of_frames_that_were_seen():
    leaf = RESULT.organs[0]
    coordinates = leaf.model.coordinates.copy()
    coordinates[~leaf.displacement.valid] = 9.0
    document = modes_document(
        replace(RESULT, organs=(replace(leaf, model=replace(leaf.model, coordinates=coordinates)),)), SPEC
    )
    assert document["organs"][0]["modes"][0]["amplitude_m"] == pytest.approx(0.04, abs=0.001)
