"""The notebook in examples/ runs as it stands: real videos are sent, and what a scan finds is read and drawn.

The scan itself is the toy of `toy_modes`: the way from pictures to modes has tests of its own, and takes minutes.
"""

import io
import json
import threading
from functools import partial
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet.joining import join, touched_plants
from scanjobs.messages import IDENTIFY
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings
from scanjobs.states import ScanState
from scanjobs.store import Store, open_store
from scanjobs.tables import Artifact, ArtifactRef, Scan, Step
from scanjobs.transitions import move_scan
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from services.api.app import create_app
from tests.fixtures.formats import drawn, write_rig_and_videos
from tests.unit.api.live import live

NOTEBOOK = Path(__file__).parents[2] / "examples/videos-to-modes.ipynb"
MODE = {
    "natural_frequency_hz": 2.0,
    "natural_frequency_hz_std": 0.01,
    "damping_ratio": 0.01,
    "damping_ratio_std": 0.001,
    "verdict": "accepted",
    "reasons": [],
    "shape": "shapes/plant_0.npz",
}


def toy_modes(store: Store, artifacts: ArtifactStore, folder: Path, ended: threading.Event) -> None:
    """Let the first scan that arrives succeed with one mode, as a worker would."""
    while not ended.wait(0.1):
        with store.read() as session:
            steps = session.execute(select(Scan.id, Step.id).join(Step).where(Scan.state == "queued")).all()
        if steps:
            store.write(partial(succeed, artifacts=artifacts, folder=folder, scan_id=steps[0][0]))
        with store.read() as session:
            touched = touched_plants(session)
        for key in touched:
            join(store, artifacts, key)


def succeed(session: Session, *, artifacts: ArtifactStore, folder: Path, scan_id: str) -> None:
    along = np.linspace(0, 1, 40)
    buffer = io.BytesIO()
    places = np.column_stack([along, 0 * along, 1 + 0 * along])
    np.savez(buffer, positions=places, shape=(along**2)[:, None], directions=np.array([[0.0, 0.0, 1.0]]))
    document = json.dumps({"organs": [{"name": "plant", "modes": [MODE]}]}).encode()
    step = Step(id=scan_id, scan_id=scan_id, kind=IDENTIFY, frame=-1, generation=0, queue="identify", depth=9)
    step.state, step.deps_left, step.created_at, step.started_at, step.finished_at = "succeeded", 0, 1.0, 2.0, 3.0
    session.add(step)
    session.flush()
    for role, content in {"modes.json": document, "shapes/plant_0.npz": buffer.getvalue()}.items():
        path = folder / "made"
        path.write_bytes(content)
        stored = artifacts.put(path)
        values = {"digest": stored.digest, "size": stored.size, "media_type": "application/octet-stream"}
        session.execute(insert(Artifact).values(values | {"state": "stored", "created_at": 0.0}))
        ref = {"step_id": step.id, "role": role, "name": Path(role).name, "digest": stored.digest}
        session.execute(insert(ArtifactRef).values(ref))
    scan = session.get_one(Scan, scan_id)
    move_scan(session, scan, ScanState.RUNNING)
    move_scan(session, scan, ScanState.SUCCEEDED)


def test_the_notebook_runs_from_videos_to_a_plot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    videos = tmp_path / "bench"
    videos.mkdir()
    write_rig_and_videos(videos, drawn(8))
    settings = Settings(data_folder=tmp_path / "data")
    upgrade(settings.database)
    store, artifacts = open_store(settings.database), ArtifactStore(settings.artifacts)
    notebook, ended = nbformat.read(NOTEBOOK, as_version=4), threading.Event()
    worker = threading.Thread(target=toy_modes, args=(store, artifacts, tmp_path, ended))
    worker.start()
    try:
        with live(create_app(settings, store, artifacts)) as address:
            for name, value in {"NERFMODAL_URL": address, "VIDEOS": str(videos), "OUT": str(tmp_path / "out")}.items():
                monkeypatch.setenv(name, value)
            monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
            NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    finally:
        ended.set()
        worker.join(30)
        store.close()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    assert "2.000 ± 0.010 Hz" in "".join(output.get("text", "") for output in outputs)
    assert "Plant(id='acai-7'" in outputs[-1]["data"]["text/plain"]
