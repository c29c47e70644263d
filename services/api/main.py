"""The process entry of the API: `uvicorn --factory services.api.main:app`."""

from fastapi import FastAPI
from scanjobs.settings import Settings

from services.api.app import create_app


def app() -> FastAPI:
    """The API with the settings of the environment."""
    return create_app(Settings())
