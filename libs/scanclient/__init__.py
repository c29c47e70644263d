"""The HTTP client of nerfmodal: typed results, typed errors; knows neither the science nor the services."""

from scanclient.async_client import AsyncClient
from scanclient.client import Client
from scanclient.errors import (
    BrokenDownload,
    BrokenUpload,
    Conflict,
    ConnectionFailed,
    InvalidRequest,
    NoRoom,
    NotAllowed,
    NotFound,
    Problem,
    ScanCanceled,
    ScanClientError,
    ScanFailed,
    ServiceFailed,
    TooManyRequests,
    WaitTimedOut,
)
from scanclient.fleet_values import Alarm, Plant, Track
from scanclient.values import Artifact, Capture, LogLine, Page, Scan, ScanFailure, StepProgress, Upload, is_result

__all__ = [
    "Alarm",
    "Artifact",
    "AsyncClient",
    "BrokenDownload",
    "BrokenUpload",
    "Capture",
    "Client",
    "Conflict",
    "ConnectionFailed",
    "InvalidRequest",
    "LogLine",
    "NoRoom",
    "NotAllowed",
    "NotFound",
    "Page",
    "Plant",
    "Problem",
    "Scan",
    "ScanCanceled",
    "ScanClientError",
    "ScanFailed",
    "ScanFailure",
    "ServiceFailed",
    "StepProgress",
    "TooManyRequests",
    "Track",
    "Upload",
    "WaitTimedOut",
    "is_result",
]
