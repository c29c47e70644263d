"""A service with scans in it, as the page meets it: no worker, every file made in closed form."""

from pathlib import Path
from typing import Any

from nerfmodal import io
from nerfmodal.export import publish
from nerfmodal.figures.numbers import write_numbers
from nerfmodal.identify.comparison import modes_as_truth
from nerfmodal.types import PointCloud
from scanjobs.artifacts import ArtifactStore
from scanjobs.messages import EXTRACT, RENDER
from scanjobs.settings import Settings
from scanjobs.states import ScanState, StepState
from scanjobs.store import open_store
from scanjobs.tables import ArtifactRef, Step
from sqlalchemy import update
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.conftest import copy_database
from tests.fixtures.scans import small_cloud, small_frame, small_result, small_spec
from tests.unit.api.service import Service

SUBMITTED, FINISHED = 1_767_247_200.0, 1_767_247_260.0


def open_service(folder: Path, migrated: Path, **settings: Any) -> Service:
    """A service on a folder of its own; close its `store` at the end."""
    captures = folder / "captures"
    captures.mkdir(parents=True)
    found = Settings(data_folder=folder / "data", capture_roots=(captures,), **settings)
    copy_database(migrated, found.data_folder)
    store = open_store(found.database)
    artifacts = ArtifactStore(found.artifacts)
    http = TestClient(create_app(found, store, artifacts), raise_server_exceptions=False)
    return Service(http=http, settings=found, store=store, artifacts=artifacts, folder=folder)


def finished_scan(service: Service, *, cloud: PointCloud | None = None, **changes: Any) -> str:
    """A scan of a leaf and a trunk with all its files; its id."""
    spec = small_spec()
    scan = str(service.submit(spec.model_dump(mode="json") | changes)["id"])
    out = service.folder / "published" / scan
    result, frame, points = small_result(), small_frame(), cloud or small_cloud()
    (out / "figures").mkdir(parents=True)
    numbers = [write_numbers(organ, out / f"figures/{organ.organ}.json") for organ in result.organs]
    files = publish(spec, result, frame, points, out, pictures=numbers)
    service.give(scan, {path.relative_to(out).as_posix(): path.read_bytes() for path in files})
    io.write_frame(out / "frame.zip", frame)
    io.write_cloud(out / "cloud.ply", points)
    io.write_truth(out / "truth.npz", [mode for organ in result.organs for mode in modes_as_truth(organ)])
    made = {"frame": out / "frame.zip", "truth": out / "truth.npz"}
    service.give(scan, {role: path.read_bytes() for role, path in made.items()}, kind=RENDER, frame=0)
    named = update(ArtifactRef).where(ArtifactRef.role == "truth").values(name="truth.npz")
    service.store.write(lambda session: session.execute(named))
    service.give(scan, {"cloud": (out / "cloud.ply").read_bytes()}, kind=EXTRACT, frame=0)
    finish(service, scan)
    return scan


def finish(service: Service, scan: str) -> None:
    """Say that every step has succeeded, and the scan with them."""
    times = {"started_at": SUBMITTED, "finished_at": FINISHED}
    steps = update(Step).where(Step.scan_id == scan).values(state=StepState.SUCCEEDED, **times)
    service.store.write(lambda session: session.execute(steps))
    service.move(scan, state=ScanState.SUCCEEDED, **times)
