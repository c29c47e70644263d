"""The one factory of the API: tests pass other parts to the same function."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from fastapi import FastAPI
from scanjobs.artifacts import ArtifactStore
from scanjobs.object_store import open_artifacts
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from starlette.concurrency import run_in_threadpool

from services.api import errors
from services.api.cursors import Cursors
from services.api.deliveries import Deliveries
from services.api.dependencies import Parts
from services.api.doorkeeper import Doorkeeper
from services.api.intake import Intake
from services.api.middleware import BodyLimit, RequestIds
from services.api.news import News
from services.api.openapi import document_refusals
from services.api.routes import (
    alarms,
    artifacts,
    brapi,
    captures,
    console,
    environment,
    events,
    exports,
    fleet,
    forks,
    frames,
    health,
    history,
    info,
    keys,
    metrics,
    modes,
    plants,
    preflight,
    rigs,
    scans,
    schedules,
    steps,
    tracks,
    uploads,
    webhooks,
    workers,
)

ROUTES = (
    scans,
    forks,
    steps,
    events,
    modes,
    frames,
    artifacts,
    uploads,
    captures,
    keys,
    webhooks,
    workers,
    fleet,
    plants,
    environment,
    history,
    tracks,
    alarms,
    schedules,
    exports,
    brapi,
    preflight,
    rigs,
    info,
    health,
    metrics,
    console,
)
DESCRIPTION = """Scans of vibrating plants and structures: pictures or point clouds in, natural frequencies, damping
ratios and mode shapes out. Refusals are problem+json (RFC 9457) with a stable `code`."""


def create_app(settings: Settings, store: Store | None = None, artifact_store: ArtifactStore | None = None) -> FastAPI:
    """The API over a database that has its tables already.

    A `store` that is given stays open when the app ends; one that is opened here is closed.
    """
    own = store is None
    store = store or open_store(settings.database)
    parts = Parts(
        settings=settings,
        store=store,
        cursors=Cursors(store),
        news=News(store),
        intake=Intake(store),
        artifacts=artifact_store or open_artifacts(settings),
    )

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        delivering = asyncio.create_task(Deliveries(store, settings).run())
        yield
        delivering.cancel()
        with suppress(asyncio.CancelledError):
            await delivering
        await parts.news.close()
        await run_in_threadpool(parts.intake.close)
        if own:
            parts.store.close()

    app = FastAPI(
        title="nerfmodal",
        version=info.package_version(),
        description=DESCRIPTION,
        lifespan=lifespan,
    )
    app.state.parts = parts
    app.add_middleware(BodyLimit)
    app.add_middleware(Doorkeeper, settings=settings, store=store)
    app.add_middleware(RequestIds)
    metrics.install(app)
    errors.install(app)
    for module in ROUTES:
        app.include_router(module.router)
    document_refusals(app)
    return app
