"""The plan: parents before children, depths that grow, and the paper's order of frames."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nerfmodal.spec import ScanSpec
from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, READ, RENDER, TRAIN
from scanjobs.plan import IDENTIFY_ALL, TRAIN_FIRST, StepKey, first_steps, frame_steps, is_essential, later_steps


@given(frames=st.integers(1, 40), make=st.sampled_from([RENDER, READ]))
def test_plan_is_a_graph_in_order(frames: int, make: str) -> None:
    depths: dict[StepKey, int] = {}
    for step in frame_steps(make, frames):
        assert step.key not in depths
        assert all(depths[parent] < step.depth for parent in step.parents)
        depths[step.key] = step.depth
    assert len(depths) == 3 * frames + 2


@given(frames=st.integers(1, 40))
def test_every_frame_starts_from_the_shared_checkpoint_and_is_identified(frames: int) -> None:
    steps = {step.key: step for step in frame_steps(RENDER, frames)}
    for k in range(frames):
        assert {TRAIN_FIRST, StepKey(RENDER, 0), StepKey(RENDER, k)} == set(steps[StepKey(TRAIN, k)].parents)
        assert {StepKey(TRAIN, k), StepKey(RENDER, k)} == set(steps[StepKey(EXTRACT, k)].parents)
        assert StepKey(EXTRACT, k) in steps[IDENTIFY_ALL].parents
    assert StepKey(RENDER, 0) in steps[IDENTIFY_ALL].parents


@pytest.mark.parametrize("kind", ["capture", "clouds"])
def test_files_are_inspected_first(kind: str) -> None:
    spec = ScanSpec.model_validate({"source": {"kind": kind, "path": "x"}})
    assert [step.key.kind for step in first_steps(spec)] == [INSPECT]


def test_clouds_are_only_identified() -> None:
    spec = ScanSpec.model_validate({"source": {"kind": "clouds", "path": "x"}})
    assert [step.key.kind for step in later_steps(spec, 0)] == [IDENTIFY]


def test_only_a_frame_that_others_do_not_need_may_be_lost() -> None:
    lost = [step.key for step in frame_steps(READ, 2) if not is_essential(step.key)]
    assert lost == [
        StepKey(READ, 1),
        StepKey(TRAIN, 0),
        StepKey(EXTRACT, 0),
        StepKey(TRAIN, 1),
        StepKey(EXTRACT, 1),
    ]
