"""A service without workers: the app over a real SQLite file, and steps that a test finishes by hand."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from scanjobs.artifacts import ArtifactStore
from scanjobs.fanin import plant_next_chunk, unplanted_scans
from scanjobs.messages import IDENTIFY
from scanjobs.owners import issue_key
from scanjobs.repository import LOCAL_OWNER, get_scan, list_steps
from scanjobs.scopes import Scope
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.tables import Artifact, ArtifactRef, Scan, Step
from sqlalchemy import update
from starlette.testclient import TestClient

from services.api.app import create_app

Json = dict[str, Any]


def simulation(**changes: Any) -> Json:
    """A small valid specification."""
    source = {
        "kind": "simulation",
        "frames": 3,
        "frame_rate_hz": 30,
        "motion": [{"organ": "leaf_*", "shape": "bending_1", "frequency_hz": 2, "amplitude_m": 0.04}],
    }
    return {"source": source} | changes


@dataclass
class Service:
    """The app, how to call it, and what lies under it."""

    http: TestClient
    settings: Settings
    store: Store
    artifacts: ArtifactStore
    folder: Path

    def submit(self, spec: Json | None = None, **headers: str) -> Json:
        answer = self.http.post("/v1/scans", json=spec or simulation(), headers=headers)
        assert answer.status_code == 202, answer.text
        body: Json = answer.json()
        self.plant()
        return body

    def plant(self) -> None:
        """Write the plans down, as the next tick of a worker would."""
        with self.store.read() as session:
            waiting = unplanted_scans(session)
        for scan_id in waiting:
            while self.store.write(partial(plant_next_chunk, scan_id=scan_id)):
                continue

    def app(self) -> FastAPI:
        """The app itself."""
        app = self.http.app
        assert isinstance(app, FastAPI)
        return app

    def key(self, owner: str, *scopes: Scope, **values: Any) -> str:
        """A new key's secret."""
        issued = self.store.write(
            lambda session: issue_key(session, owner=owner, name="test", scopes=scopes or tuple(Scope), **values)
        )
        return issued.secret

    def locked(self) -> TestClient:
        """The same service as callers elsewhere meet it: nothing without a key."""
        settings = self.settings.model_copy(update={"keyless": False})
        return TestClient(create_app(settings, self.store, self.artifacts), raise_server_exceptions=False)

    def rows(self) -> int:
        """Scans stored, whoever owns them."""
        with self.store.read() as session:
            return session.query(Scan).count()

    def give(self, scan: str, files: Mapping[str, bytes], *, kind: str = IDENTIFY, frame: int = -1) -> None:
        """Let a step have made these files (role → bytes)."""
        self.plant()
        with self.store.read() as session:
            steps = list_steps(session, get_scan(session, scan, owner=LOCAL_OWNER))
        [step] = [step for step in steps if (step.kind, step.frame) == (kind, frame)]
        for role, content in files.items():
            self._give_one(step, role, content)

    def move(self, scan: str, **values: Any) -> None:
        """Write into the scan's row, as a worker would have."""
        self.store.write(lambda session: session.execute(update(Scan).where(Scan.id == scan).values(values)))

    def move_step(self, scan: str, kind: str, frame: int, **values: Any) -> None:
        """Write into a step's row, as a worker would have."""
        which = (Step.scan_id == scan, Step.kind == kind, Step.frame == frame)
        self.store.write(lambda session: session.execute(update(Step).where(*which).values(values)))

    def _give_one(self, step: Step, role: str, content: bytes) -> None:
        source = self.folder / "content"
        source.write_bytes(content)
        stored = self.artifacts.put(source)
        kind = "application/json" if role.endswith(".json") else "application/octet-stream"

        def work(session: Any) -> None:
            row = Artifact(digest=stored.digest, size=stored.size, media_type=kind, state="stored", created_at=0.0)
            session.merge(row)
            session.flush()
            session.add(ArtifactRef(step_id=step.id, role=role, name=Path(role).name, digest=stored.digest))

        self.store.write(work)
