"""The numbers follow from the lines that were tried: known errors in, known bias, spread and limit out."""

import json

import numpy as np
import pytest
from nerfmodal.bounds import cramer_rao
from nerfmodal.certificate import Settings, board_before, certificate_document
from nerfmodal.certificate.target import AMPLITUDES, DAMPING_RATIO, Board, true_modes
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.identify.comparison import ComparisonRow
from nerfmodal.spec import RigSpec
from nerfmodal.types import TrueMode, Verdict

RIG = semi_spherical_rig(RigSpec(cameras=12, width_px=320, height_px=240, radius_m=2.5))
SETTINGS = Settings(frame_rate=30.0)
TIMES = np.arange(SETTINGS.frames) / SETTINGS.frame_rate


@pytest.fixture(scope="module")
def board() -> Board:
    return board_before(RIG, np.random.default_rng(0), 160)


def row(mode: TrueMode, error: float, verdict: Verdict | None) -> ComparisonRow:
    found = None if verdict is None else mode.frequency + error
    return ComparisonRow(
        organ=mode.organ,
        mode=1,
        truth_hz=mode.frequency,
        found_hz=found,
        truth_damping=mode.damping_ratio,
        found_damping=None if verdict is None else DAMPING_RATIO,
        mac=None if verdict is None else 0.99,
        verdict=verdict,
    )


def test_an_amplitude_counts_from_where_all_larger_ones_are_seen(board: Board):
    modes = true_modes(board, 30.0, TIMES)
    blades = {mode.organ: index for index, mode in enumerate(modes[::3])}
    seen = {1: Verdict.ACCEPTED, 3: Verdict.ACCEPTED, 4: Verdict.ACCEPTED, 5: Verdict.ACCEPTED, 2: Verdict.DOUBTFUL}
    rows = [row(mode, 0.0, seen.get(blades[mode.organ])) for mode in modes]
    document = certificate_document(RIG, board, SETTINGS, rows, modes)
    for one in document["frequencies"]:
        assert (one["tried"], one["detected"]) == (6, 4)
        assert one["smallest_amplitude_m"] == pytest.approx(AMPLITUDES[3] * board.grain)
    nothing = certificate_document(RIG, board, SETTINGS, [row(mode, 0.0, None) for mode in modes], modes)
    assert [one["smallest_amplitude_m"] for one in nothing["frequencies"]] == [None] * 3
    assert nothing["noise_per_grain"] is None


def test_errors_in_proportion_to_the_bound_give_back_their_noise(board: Board):
    """Every error is one deviation of a noise of 0.3 mm, to either side."""
    modes = true_modes(board, 30.0, TIMES)
    rows = []
    for index, mode in enumerate(modes):
        amplitude = AMPLITUDES[int(mode.organ.split("_")[1])] * board.grain
        bound, _ = cramer_rao(TIMES, mode.frequency, DAMPING_RATIO, amplitude / 0.0003)
        rows.append(row(mode, bound * (-1) ** (index // 3), Verdict.ACCEPTED))
    document = certificate_document(RIG, board, SETTINGS, rows, modes)
    assert [one["noise_m"] for one in document["frequencies"]] == pytest.approx([0.0003] * 3)
    assert document["noise_per_grain"] == pytest.approx(0.0003 / board.grain)


def test_the_same_trial_has_the_same_id_and_another_has_not(board: Board):
    modes = true_modes(board, 30.0, TIMES)
    rows = [row(mode, 0.001, Verdict.ACCEPTED) for mode in modes]
    first, again = (certificate_document(RIG, board, SETTINGS, rows, modes) for _ in range(2))
    assert first["id"] == again["id"]
    other = certificate_document(RIG, board, SETTINGS, [*rows[:-1], row(modes[-1], 0.002, Verdict.ACCEPTED)], modes)
    assert (other["id"] != first["id"], other["rig_digest"] == first["rig_digest"]) == (True, True)
    assert json.loads(json.dumps(first, allow_nan=False)) == first
