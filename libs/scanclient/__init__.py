"""The HTTP client of nerfmodal: typed results, typed errors; knows neither the science nor the services."""

from scanclient.client import Client, is_result
from scanclient.errors import (
    BrokenDownload,
    Conflict,
    ConnectionFailed,
    InvalidRequest,
    NotAllowed,
    NotFound,
    Problem,
    ScanCanceled,
    ScanClientError,
    ScanFailed,
    ServiceFailed,
    WaitTimedOut,
)
from scanclient.values import Artifact, Page, Scan, ScanFailure, StepProgress

__all__ = [
    "Artifact",
    "BrokenDownload",
    "Client",
    "Conflict",
    "ConnectionFailed",
    "InvalidRequest",
    "NotAllowed",
    "NotFound",
    "Page",
    "Problem",
    "Scan",
    "ScanCanceled",
    "ScanClientError",
    "ScanFailed",
    "ScanFailure",
    "ServiceFailed",
    "StepProgress",
    "WaitTimedOut",
    "is_result",
]
