"""The plan: parents before children, depths that grow, and the paper's order of frames."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nerfmodal.spec import ScanSpec
from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, READ, RENDER, TRAIN
from scanjobs.plan import (
    IDENTIFY_ALL,
    TRAIN_FIRST,
    StepKey,
    first_steps,
    frame_steps,
    is_essential,
    is_partial,
    later_steps,
)

MOTION = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.0, "amplitude_m": 0.01}
SIMULATION = {"kind": "simulation", "frames": 3, "frame_rate_hz": 30.0, "motion": [MOTION]}
CAPTURE = {"kind": "capture", "path": "x"}


def spec_of(source: dict[str, object], partial_every: int | None = None, field: str = "grid") -> ScanSpec:
    """A specification; the number of frames is given to the plan."""
    parts = {"source": source, "partial_every": partial_every, "reconstruction": {"field": field}}
    return ScanSpec.model_validate(parts)


@given(frames=st.integers(1, 700), source=st.sampled_from([SIMULATION, CAPTURE]))
def test_plan_is_a_graph_in_order(frames: int, source: dict[str, object]) -> None:
    """Also over the borders of chunks: no step comes before its parent."""
    depths: dict[StepKey, int] = {}
    for step in frame_steps(spec_of(source), frames):
        assert step.key not in depths
        assert all(depths[parent] < step.depth for parent in step.parents)
        depths[step.key] = step.depth
    assert len(depths) == 3 * frames + 2


@given(frames=st.integers(1, 40))
def test_every_frame_starts_from_the_shared_checkpoint_and_is_identified(frames: int) -> None:
    steps = {step.key: step for step in frame_steps(spec_of(SIMULATION), frames)}
    for k in range(frames):
        assert {TRAIN_FIRST, StepKey(RENDER, 0), StepKey(RENDER, k)} == set(steps[StepKey(TRAIN, k)].parents)
        assert {StepKey(TRAIN, k), StepKey(RENDER, k)} == set(steps[StepKey(EXTRACT, k)].parents)
        assert StepKey(EXTRACT, k) in steps[IDENTIFY_ALL].parents
    assert StepKey(RENDER, 0) in steps[IDENTIFY_ALL].parents


@given(frames=st.integers(1, 700), every=st.integers(16, 300))
def test_modes_so_far_wait_for_every_cloud_before_them_with_one_edge_each(frames: int, every: int) -> None:
    steps = {step.key: step for step in frame_steps(spec_of(SIMULATION, every), frames)}
    partials = [steps[key] for key in steps if is_partial(key)]
    assert [step.key.frame for step in partials] == list(range(every, frames, every))
    waited: set[StepKey] = set()
    for step in partials:
        clouds = {parent for parent in step.parents if parent.kind == EXTRACT}
        assert len(clouds) == every
        waited |= clouds
        assert waited == {StepKey(EXTRACT, k) for k in range(step.key.frame)}
    assert not any(is_partial(parent) for parent in steps[IDENTIFY_ALL].parents)


@pytest.mark.parametrize(("field", "queue"), [("grid", "train-cpu"), ("mlp", "train-gpu")])
def test_large_networks_are_trained_where_a_gpu_is(field: str, queue: str) -> None:
    steps = frame_steps(spec_of(SIMULATION, field=field), 2)
    assert {step.queue for step in steps if step.key.kind == TRAIN} == {queue}


@pytest.mark.parametrize("kind", ["capture", "clouds"])
def test_files_are_inspected_first(kind: str) -> None:
    spec = ScanSpec.model_validate({"source": {"kind": kind, "path": "x"}})
    assert [step.key.kind for step in first_steps(spec)] == [INSPECT]


def test_clouds_are_only_identified() -> None:
    spec = ScanSpec.model_validate({"source": {"kind": "clouds", "path": "x"}})
    assert [step.key.kind for step in later_steps(spec, 0)] == [IDENTIFY]


def test_only_a_frame_that_others_do_not_need_may_be_lost() -> None:
    lost = [step.key for step in frame_steps(spec_of(CAPTURE), 2) if not is_essential(step.key)]
    assert lost == [
        StepKey(READ, 1),
        StepKey(TRAIN, 0),
        StepKey(EXTRACT, 0),
        StepKey(TRAIN, 1),
        StepKey(EXTRACT, 1),
    ]
