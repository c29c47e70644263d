"""Faults inside the real stages, not toys: Blender in the middle of a picture, a field in its training."""

import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal import io
from nerfmodal.spec import ScanSpec
from scanjobs import control
from scanjobs.artifacts import ArtifactStore
from scanjobs.messages import RENDER, TRAIN
from scanjobs.migrate import upgrade
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings

from tests.integration.toy_service import Service, is_alive, looking_at, toy_settings, worker_process

MOTION = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.07, "amplitude_m": 0.06}
START_S = 120.0
"""A runner loads Blender or torch first."""


def spec_of(renderer: str, iterations: int = 300, samples: int = 1, **rig: Any) -> ScanSpec:
    """One frame of a palm."""
    source = {"kind": "simulation", "frames": 1, "frame_rate_hz": 12, "motion": [MOTION], "rig": rig}
    training = {"iterations": iterations, "fine_tune_iterations": 5, "voxel_m": 0.04, "points": 500}
    return ScanSpec.model_validate(
        {"source": {**source, "renderer": renderer, "samples": samples}, "reconstruction": training}
    )


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """The real tasks; a training saves its state whenever it can."""
    chosen = toy_settings(tmp_path).model_copy(
        update={"tasks": "services.worker.tasks", "lease_s": 20.0, "save_every_s": 0.2}
    )
    upgrade(chosen.database)
    return chosen


@pytest.fixture
def service(settings: Settings) -> Iterator[Service]:
    """A look at the database, and a worker in a process of its own."""
    with looking_at(settings) as looking, worker_process(settings):
        yield looking


def assert_cancelled_in_time(service: Service, scan_id: str, runner: int) -> None:
    """Promise (e)."""
    asked_at = time.monotonic()
    service.store.write(lambda session: control.cancel_scan(session, scan_id))
    assert service.end_of(scan_id, 5).state == "canceled"
    assert time.monotonic() - asked_at < 5
    assert not is_alive(runner)
    assert service.violations() == ()


def has_told(service: Service, scan_id: str, kind: str, frame: int) -> bool:
    """Whether the step has told how far it is."""
    return service.step(scan_id, kind, frame).progress_total > 0


def is_trained(service: Service, scan_id: str) -> bool:
    """Whether the shared checkpoint is there."""
    return service.step(scan_id, TRAIN, WHOLE_SCAN).state == "succeeded"


def test_cancel_inside_a_blender_render(service: Service) -> None:
    """Pictures of nine million pixels with 4,096 rays each take minutes, and Blender listens to nobody meanwhile."""
    pytest.importorskip("bpy", reason="pip install 'nerfmodal[simulate]'")
    spec = spec_of("blender", samples=4096, cameras=3, width_px=3000, height_px=3000)
    scan_id = service.submit(spec)
    runner = service.runner_of(scan_id, RENDER, 0, seconds=START_S)
    time.sleep(6.0)  # Blender has been loaded and renders its first picture
    assert_cancelled_in_time(service, scan_id, runner)


def test_cancel_inside_a_training(service: Service) -> None:
    """Half a million iterations, stopped after the first it tells of."""
    scan_id = service.submit(spec_of("preview", iterations=500_000, cameras=4, width_px=64, height_px=92))
    runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN, seconds=START_S)
    service.wait(lambda: has_told(service, scan_id, TRAIN, WHOLE_SCAN), START_S)
    assert_cancelled_in_time(service, scan_id, runner)


def test_terminated_training_ends_with_the_same_weights(settings: Settings) -> None:
    """Fault 13 with a real field: stopped by SIGTERM after it has saved, it ends bit for bit as if undisturbed."""
    spec = spec_of("preview", iterations=250, cameras=4, width_px=64, height_px=92)
    with looking_at(settings) as service:
        with worker_process(settings) as worker:
            scan_id = service.submit(spec)
            service.runner_of(scan_id, TRAIN, WHOLE_SCAN, seconds=START_S)
            service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).resume_digest is not None, START_S)
            worker.signal(signal.SIGTERM)
            assert worker.wait(15) == 0
        step = service.step(scan_id, TRAIN, WHOLE_SCAN)
        assert (step.state, step.attempt) == ("ready", 0)
        assert step.resume_digest is not None
        with worker_process(settings):
            undisturbed = service.submit(spec)
            for one in (scan_id, undisturbed):
                service.wait(partial(is_trained, service, one), 2 * START_S)
        disturbed, other = (weights_of(service, one) for one in (scan_id, undisturbed))
        assert disturbed.keys() == other.keys()
        assert all(np.array_equal(disturbed[name], other[name]) for name in other)


def weights_of(service: Service, scan_id: str) -> dict[str, np.ndarray]:
    """The arrays of the shared checkpoint; its file also tells how long it took."""
    path = ArtifactStore(service.settings.artifacts).path(service.file(scan_id, TRAIN, WHOLE_SCAN, "checkpoint"))
    return dict(io.read_checkpoint(path).state)
