"""A certificate from pictures to numbers, as small as can be: what moves by two pixels is seen, and nothing else."""

import pytest
from nerfmodal.certificate import Settings, certify
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.spec import RigSpec

RIG = semi_spherical_rig(RigSpec(cameras=10, width_px=96, height_px=96, radius_m=2.0))
SMALL = Settings(frame_rate=30.0, frames=32, iterations=160, fine_tune_iterations=24, voxels=64)


def test_the_largest_motions_are_read_and_nothing_is_seen_that_is_not_there():
    told: list[str] = []
    document = certify(RIG, SMALL, report=lambda stage, _: told.append(stage))
    assert document["false_modes"] == 0
    largest = [line for line in document["lines"] if line["patch"] == "blade_5"]
    assert [line["detected"] for line in largest] == [True] * 3
    assert [line["found_hz"] for line in largest] == pytest.approx([line["frequency_hz"] for line in largest], rel=0.02)
    assert all(one["smallest_amplitude_m"] is not None for one in document["frequencies"])
    assert {"film", "train first", "reconstruct", "identify"} <= set(told)
