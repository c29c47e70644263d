"""What a runner can compute: load, call the pipeline, save. Imported by runners only."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, READ, RENDER, TRAIN

from services.worker.job import Task
from services.worker.tasks.extract import extract_frame
from services.worker.tasks.identify import identify_scan
from services.worker.tasks.inspect import inspect_source
from services.worker.tasks.read import read_frame
from services.worker.tasks.render import render_frame
from services.worker.tasks.train import train_frame

TASKS: Final[Mapping[str, Task]] = MappingProxyType(
    {
        INSPECT: inspect_source,
        RENDER: render_frame,
        READ: read_frame,
        TRAIN: train_frame,
        EXTRACT: extract_frame,
        IDENTIFY: identify_scan,
    }
)
