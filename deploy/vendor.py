"""Put the console's libraries into services/api/console/vendor: `python deploy/vendor.py`, wherever npm is installed.

Versions are pinned here, and so is the SHA-512 of each package as the registry gives it. The page needs no Node: what
is fetched are files that a browser takes as they are. `vendor.json` says of every file where it comes from, its licence
and its SHA-256; a test holds the files to it.
"""

import base64
import hashlib
import json
import subprocess
import tarfile
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

TARGET = Path(__file__).parents[1] / "services/api/console/vendor"


@dataclass(frozen=True, slots=True, kw_only=True)
class Package:
    """A package: which of its files become which of ours, and the words in them that are changed.

    A bare name in an import would need an import map in the page, which is inline script: such names become paths.
    """

    name: str
    version: str
    licence: str
    sha512: str
    files: Mapping[str, str]
    changes: Mapping[str, str] = field(default_factory=dict)


PACKAGES = (
    Package(
        name="htm",
        version="3.1.1",
        licence="Apache-2.0",
        sha512="983Vyg8NwUE7JkZ6NmOqpCZ+sh1bKv2iYTlUkzlWmA5JD2acKoxd4KVxbMmxX/85mtfdnDmTFoNKcg5DGAvxNQ==",
        files={"dist/htm.module.js": "htm.js", "LICENSE": "htm.LICENSE"},
    ),
    Package(
        name="preact",
        version="10.25.4",
        licence="MIT",
        sha512="jLdZDb+Q+odkHJ+MpW/9U5cODzqnB+fy2EiHSZES7ldV5LK7yjlVzTp7R8Xy6W6y75kfK8iWYtFVH7lvjwrCMA==",
        files={
            "dist/preact.module.js": "preact.js",
            "hooks/dist/hooks.module.js": "hooks.js",
            "LICENSE": "preact.LICENSE",
        },
        changes={'from"preact"': 'from"./preact.js"', "//# sourceMappingURL": "// source map: not vendored"},
    ),
    Package(
        name="uplot",
        version="1.6.32",
        licence="MIT",
        sha512="KIMVnG68zvu5XXUbC4LQEPnhwOxBuLyW1AHtpm6IKTXImkbLgkMy+jabjLgSLMasNuGGzQm/ep3tOkyTxpiQIw==",
        files={"dist/uPlot.esm.js": "uplot.js", "dist/uPlot.min.css": "uplot.css", "LICENSE": "uplot.LICENSE"},
    ),
    Package(
        name="three",
        version="0.180.0",
        licence="MIT",
        sha512="o+qycAMZrh+TsE01GqWUxUIKR1AL0S8pq7zDkYOQw8GqfX8b8VoCKYUoHbhiX5j+7hr8XsuHDVU6+gkQJQKg9w==",
        files={
            "build/three.core.min.js": "three.core.min.js",
            "build/three.module.min.js": "three.module.min.js",
            "examples/jsm/controls/OrbitControls.js": "orbit.js",
            "LICENSE": "three.LICENSE",
        },
        changes={"from 'three';": "from './three.module.min.js';"},
    ),
)


def fetch(package: Package, folder: Path) -> Path:
    """The package as npm fetches it. Raises `SystemExit` where its bytes are not those that were pinned."""
    wanted = f"{package.name}@{package.version}"
    done = subprocess.run(["npm", "pack", wanted, "--silent"], cwd=folder, check=True, capture_output=True, text=True)
    path = folder / done.stdout.strip().splitlines()[-1]
    found = base64.b64encode(hashlib.sha512(path.read_bytes()).digest()).decode()
    if found != package.sha512:
        raise SystemExit(f"{wanted} has the SHA-512 {found}, not {package.sha512}")
    return path


def unpack(package: Package, archive: Path) -> list[dict[str, str]]:
    """Write the package's files; what `vendor.json` says of them."""
    with tarfile.open(archive) as tar:
        return [_write(package, tar, source, name) for source, name in package.files.items()]


def _write(package: Package, tar: tarfile.TarFile, source: str, name: str) -> dict[str, str]:
    member = tar.extractfile(f"package/{source}")
    assert member is not None
    text = member.read().decode()
    for old, new in package.changes.items():
        text = text.replace(old, new)
    (TARGET / name).write_text(text)
    return {
        "file": name,
        "package": package.name,
        "version": package.version,
        "source": source,
        "licence": package.licence,
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
    }


if __name__ == "__main__":
    TARGET.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        rows = [row for package in PACKAGES for row in unpack(package, fetch(package, Path(scratch)))]
    (TARGET / "vendor.json").write_text(json.dumps(rows, indent=2) + "\n")
