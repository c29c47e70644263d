"""A real scan, small: through the service and in one process it gives the same modes, and never reads the truth."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io, pipeline
from nerfmodal.identify.comparison import compare
from nerfmodal.spec import ScanSpec
from nerfmodal.types import Outcome, ScanResult
from scanjobs.artifacts import ArtifactStore
from scanjobs.repository import find_artifact
from scanjobs.settings import Settings
from scanjobs.store import open_store

from services.worker.app import embedded_worker
from tests.integration.toy_service import Service

FOX = Path(__file__).parents[2] / ".." / "shared" / "captures" / "fox"
SPEC = ScanSpec.model_validate(
    {
        "name": "small",
        "source": {
            "kind": "simulation",
            "frames": 36,
            "frame_rate_hz": 12.0,
            "renderer": "preview",
            "rig": {"cameras": 12, "width_px": 96, "height_px": 138},
            "motion": [
                {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.07, "amplitude_m": 0.06, "phase_deg": 20}
            ],
        },
        "reconstruction": {
            "motion": "refit",
            "voxel_m": 0.03,
            "iterations": 240,
            "fine_tune_iterations": 120,
            "points": 6000,
        },
        "organs": [
            {
                "name": "trunk",
                "region": {"center_m": [0, 0, 1.1], "size_m": [0.5, 0.5, 2.0]},
                "surface": "cylinder",
                "degree": 4,
            }
        ],
    }
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("whole")


@pytest.fixture(scope="module")
def alone(folder: Path) -> ScanResult:
    return pipeline.run(SPEC, folder / "alone", report=lambda *_: None)


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[Service]:
    settings = Settings(data_folder=folder / "service", slots=2, lease_s=30.0, tick_s=0.2, capture_roots=(FOX.parent,))
    with embedded_worker(settings):
        store = open_store(settings.database)
        yield Service(settings, store)
        store.close()


def result_of(service: Service, spec: ScanSpec) -> tuple[str, ScanResult]:
    scan = service.submit(spec)
    ended = service.end_of(scan, 400.0)
    assert ended.state == "succeeded", ended.error
    with service.store.read() as session:
        stored = find_artifact(session, service.scan(scan), "result.npz")
    assert stored is not None
    return scan, io.read_result(ArtifactStore(service.settings.artifacts).path(stored.digest))


def test_the_service_and_one_process_give_the_same_modes(service: Service, alone: ScanResult) -> None:
    _, served = result_of(service, SPEC)
    for one, other in zip(served.organs, alone.organs, strict=True):
        # the runners compute with one thread: sums of floating-point numbers are cut differently, nothing else
        np.testing.assert_allclose(one.model.frequencies, other.model.frequencies, rtol=1e-9)
        np.testing.assert_allclose(one.model.damping_ratios, other.model.damping_ratios, rtol=1e-6)
        np.testing.assert_allclose(one.model.mode_shapes, other.model.mode_shapes, atol=1e-9)
        verdicts = [[quality.verdict for quality in organ.model.quality] for organ in (one, other)]
        assert verdicts[0] == verdicts[1]


def test_following_finds_the_mode_in_three_components_and_is_the_same_in_the_service(
    service: Service, folder: Path
) -> None:
    reconstruction = SPEC.reconstruction.model_copy(update={"motion": None})
    spec = SPEC.model_copy(update={"reconstruction": reconstruction})
    alone = pipeline.run(spec, folder / "followed", report=lambda *_: None)
    _, served = result_of(service, spec)
    one, other = served.organs[0], alone.organs[0]
    np.testing.assert_array_equal(other.displacement.directions, np.eye(3))
    np.testing.assert_allclose(one.model.frequencies, other.model.frequencies, rtol=1e-6)
    row = next(row for row in compare(alone, pipeline.simulate.true_modes(spec.source, alone.times)))
    assert row.found_hz == pytest.approx(1.07, rel=0.02)
    assert row.mac is not None
    assert row.mac > 0.95


def test_the_imposed_mode_is_found(alone: ScanResult, folder: Path) -> None:
    rows = compare(alone, io.read_truth(folder / "alone" / "truth.npz"))
    (row,) = [row for row in rows if row.truth_hz is not None]
    assert row.found_hz == pytest.approx(1.07, rel=0.02)
    assert row.mac is not None
    assert row.mac > 0.9
    assert {path.name for path in (folder / "alone").iterdir()} >= {"modes.json", "report.html", "result.npz"}


def test_identification_never_opens_the_truth(alone: ScanResult, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clouds = [io.read_cloud(path) for path in sorted((folder / "alone" / "clouds").glob("*.ply"))]

    def refuse(*_: object) -> None:
        raise AssertionError("the identification asked for the truth")

    for module, name in ((io, "read_truth"), (pipeline.simulate, "true_modes"), (pipeline.simulate, "vertices_at")):
        monkeypatch.setattr(module, name, refuse)
    still = SPEC.source
    assert still.kind == "simulation"
    motionless = SPEC.model_copy(update={"source": still.model_copy(update={"motion": ()})})
    again = pipeline.identify(motionless, clouds, report=lambda *_: None)
    np.testing.assert_array_equal(again.organs[0].model.frequencies, alone.organs[0].model.frequencies)


@pytest.mark.usefixtures("alone")
def test_one_frame_has_no_modes_and_no_crash(folder: Path) -> None:
    cloud = io.read_cloud(folder / "alone" / "clouds" / "frame_0000.ply")
    spec = SPEC.model_copy(update={"source": SPEC.source.model_copy(update={"frames": 1})})
    result = pipeline.identify(spec, [replace(cloud, time=0.0)], report=lambda *_: None)
    assert result.outcome is Outcome.TOO_FEW_FRAMES
    assert len(result.organs[0].model.frequencies) == 0


@pytest.mark.skipif(not FOX.is_dir(), reason="the photographs of ../shared/captures/fox are not here")
def test_fifty_photographs_become_a_cloud(service: Service) -> None:
    spec = ScanSpec.model_validate(
        {
            "name": "fox",
            "source": {"kind": "capture", "path": str(FOX.resolve()), "hold_out_every": 8, "downscale": 8},
            "reconstruction": {"iterations": 160, "rays_per_batch": 2048, "points": 5000},
        }
    )
    scan, result = result_of(service, spec)
    assert result.outcome is Outcome.TOO_FEW_FRAMES
    row = service.scan(scan)
    store = ArtifactStore(service.settings.artifacts)
    with service.store.read() as session:
        cloud = find_artifact(session, row, "cloud", frame=0)
        checkpoint = find_artifact(session, row, "checkpoint", frame=0)
    assert cloud is not None
    assert checkpoint is not None
    points = io.read_cloud(store.path(cloud.digest))
    assert len(points.points) > 1000
    assert points.colors.std() > 0.02
    held_out = io.read_checkpoint(store.path(checkpoint.digest)).held_out_psnr
    assert held_out is not None
    assert held_out > 15
