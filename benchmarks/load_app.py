"""The API with one more route: `POST /v1/empty` does nothing, behind the same middleware. For `benchmarks.service`."""

from fastapi import FastAPI
from scanjobs.settings import Settings

from services.api.app import create_app


def app() -> FastAPI:
    """The app of the environment's settings; `uvicorn --factory benchmarks.load_app:app`."""
    made = create_app(Settings())

    @made.post("/v1/empty", status_code=202)
    def empty() -> dict[str, str]:
        return {}

    return made
