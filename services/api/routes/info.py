"""What the service offers: presets, the options of a specification, and itself."""

from importlib.metadata import PackageNotFoundError, version
from typing import Any
from urllib.parse import urlsplit

from fastapi import APIRouter
from nerfmodal.spec import ScanSpec
from scanjobs.repository import list_workers
from scanjobs.tables import Worker

from services.api.dependencies import TheParts
from services.api.presets import PRESETS
from services.api.schemas import Info, Preset, PresetList, WorkerDetail

router = APIRouter(prefix="/v1", tags=["info"])


@router.get("/presets")
def presets() -> PresetList:
    """Specifications to start from: copy one, change it, post it."""
    return PresetList(items=[Preset(name=name, spec=spec) for name, spec in PRESETS.items()])


@router.get("/options")
def options() -> dict[str, Any]:
    """The JSON Schema of a specification: every key, its type, bounds, default and meaning."""
    return ScanSpec.model_json_schema()


@router.get("/info")
def info(parts: TheParts) -> Info:
    """Version, kinds of database and broker, and the workers that are alive."""
    with parts.store.read() as session:
        workers = [_detail(row) for row in list_workers(session)]
    broker = urlsplit(parts.settings.broker_url).scheme
    return Info(version=package_version(), database=parts.store.dialect, broker=broker, workers=workers)


def package_version() -> str:
    """The installed version, or 0 from a bare checkout."""
    try:
        return version("nerfmodal")
    except PackageNotFoundError:
        return "0"


def _detail(row: Worker) -> WorkerDetail:
    return WorkerDetail(host=row.host, queues=row.queues.split(","), slots=row.slots)
