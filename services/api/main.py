"""The process entry of the API: `uvicorn --factory services.api.main:app`."""

from fastapi import FastAPI
from scanjobs.logs import configure
from scanjobs.settings import Settings

from services.api.app import create_app


def app() -> FastAPI:
    """The API with the settings of the environment; unlike `nerfmodal up` it asks for keys unless told otherwise."""
    settings = Settings()
    configure(settings)
    return create_app(settings.model_copy(update={"keyless": settings.keyless is True}))
