"""The embedded server: API and worker of this process around one listening socket."""

import socket

import uvicorn
from fastapi import FastAPI
from scanjobs.settings import Settings
from starlette.middleware.trustedhost import TrustedHostMiddleware

from services.api.app import create_app
from services.cli.address import announce, withdraw
from services.cli.output import results
from services.worker.app import embedded_worker

GRACE_S = 3
LOCAL_NAMES = ("127.0.0.1", "localhost")


def serve(settings: Settings, listener: socket.socket, slots: int | None) -> None:
    """Answer and compute until a signal; returns, or is unwound, with everything stopped.

    Raises
    ------
    DataFolderInUse
        Another server runs on the data folder.
    """
    with embedded_worker(settings, slots=slots):
        try:
            AnnouncedServer(local_app(settings), settings).run(sockets=[listener])
        finally:
            withdraw(settings.data_folder)


def local_app(settings: Settings) -> FastAPI:
    """The API; where no keys are asked for, a page elsewhere whose name is made to lead here is not answered."""
    app = create_app(settings)
    if settings.keyless is not False:
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(LOCAL_NAMES))
    return app


class AnnouncedServer(uvicorn.Server):
    """A server that writes its address down once it answers."""

    def __init__(self, app: FastAPI, settings: Settings) -> None:
        super().__init__(uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=GRACE_S, lifespan="on"))
        self._settings = settings

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        assert sockets is not None
        host, port = sockets[0].getsockname()[:2]
        address = f"http://{host}:{port}"
        folder = self._settings.data_folder
        announce(folder, address)
        results().print(f"nerfmodal listens at {address} (data in {folder.resolve()}); Ctrl-C stops it")
