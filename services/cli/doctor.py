"""`doctor`: what is installed, what is missing, and how to get it. Wheels are imported, each in its own process."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

import typer

from services.cli.output import Json, print_json, results, table_of

IMPORT_TIMEOUT_S = 120
SHARED_LIBRARIES = (
    "apt-get install libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6 libxi6 libxrender1 libxkbcommon0 libsm6"
)
State = Literal["ok", "missing", "broken"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A wheel: what it is imported and installed as, the extra it belongs to, and what it is for."""

    module: str
    package: str
    extra: str | None
    purpose: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What was found of a part, and what to do about it."""

    part: str
    state: State
    version: str
    purpose: str
    remedy: str
    needed: bool


PARTS = (
    Part(module="numpy", package="numpy", extra=None, purpose="arrays"),
    Part(module="scipy", package="scipy", extra=None, purpose="identification"),
    Part(module="numba", package="numba", extra=None, purpose="the grid field"),
    Part(module="fastapi", package="fastapi", extra=None, purpose="the API"),
    Part(module="celery", package="celery", extra=None, purpose="the workers"),
    Part(module="torch", package="torch", extra="vision", purpose="the MLP field"),
    Part(module="open3d", package="open3d-cpu", extra="vision", purpose="the preview renderer"),
    Part(module="bpy", package="bpy", extra="simulate", purpose="Blender's renders"),
    Part(module="pycolmap", package="pycolmap", extra="capture", purpose="poses of captures that have none"),
    Part(module="cv2", package="opencv-python-headless", extra="capture", purpose="checkerboards in captures"),
    Part(module="psycopg", package="psycopg", extra="postgres", purpose="PostgreSQL as database"),
)


def doctor(as_json: Json = False) -> None:
    """Say what is installed, what is missing and how to get it."""
    with ThreadPoolExecutor(2) as pool:
        findings = list(pool.map(examine, PARTS))
    if as_json:
        print_json({"machine": machine(), "parts": [asdict(finding) for finding in findings]})
    else:
        _print(findings)
    if any(finding.needed and finding.state != "ok" for finding in findings):
        raise typer.Exit(1)


def examine(part: Part) -> Finding:
    """Import a wheel in a process of its own, as a broken one can take its process down."""
    try:
        number = version(part.package)
    except PackageNotFoundError:
        return _finding(part, "missing", "", _how_to_install(part))
    reason = _import_failure(part.module)
    if reason is None:
        return _finding(part, "ok", number, "")
    remedy = f"{reason}: {SHARED_LIBRARIES}" if ".so" in reason else f"{reason}: {_how_to_install(part)}"
    return _finding(part, "broken", number, remedy)


def machine() -> dict[str, str | int | float]:
    """What this machine offers."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "python": sys.version.split()[0],
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "memory_gib": round(memory / 2**30, 1),
        "free_disk_gib": round(shutil.disk_usage(Path()).free / 2**30, 1),
    }


def _print(findings: list[Finding]) -> None:
    console = results()
    facts = machine()
    console.print(
        f"Python {facts['python']}, {facts['cores']} cores, {facts['memory_gib']} GiB memory, "
        f"{facts['free_disk_gib']} GiB free here"
    )
    rows = [(one.part, one.state, one.version, one.purpose, one.remedy) for one in findings]
    console.print(table_of(("part", "state", "version", "for", "what to do"), rows))


def _finding(part: Part, state: State, number: str, remedy: str) -> Finding:
    return Finding(
        part=part.module,
        state=state,
        version=number,
        purpose=part.purpose,
        remedy=remedy,
        needed=part.extra is None,
    )


def _import_failure(module: str) -> str | None:
    """The last line of what an import says, None where it works."""
    command = [sys.executable, "-c", f"import {module}"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=IMPORT_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"importing takes more than {IMPORT_TIMEOUT_S} s"
    if done.returncode == 0:
        return None
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"importing ends with code {done.returncode}"


def _how_to_install(part: Part) -> str:
    return f"pip install 'nerfmodal[{part.extra}]'" if part.extra else f"pip install {part.package}"
