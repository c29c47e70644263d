"""Captures: one film through every format, and poses solved from photographs: `python -m benchmarks.captures`.

`formats`: a ball that moves over a floor, ray-traced exactly, is written in every format that is read; `nerfmodal
reconstruct` makes clouds of each, and the service of one. Distances between clouds are compared with those of two seeds
on the same pictures: the noise.
`poses`: the fox's cameras solved anew from its pictures, against those that came with it (as given by its authors).
Prints a table and writes out/benchmarks/captures.json. Films are kept under out/benchmarks/captures.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from nerfmodal import io
from nerfmodal.capture import open_capture
from nerfmodal.capture.metric import similarity
from nerfmodal.spec import CaptureSource, ScanSpec
from nerfmodal.types import Frame
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from benchmarks.rows import Row
from services.cli.main import app
from services.cli.service_process import running_service
from tests.fixtures.formats import FILMED, FORMATS, RATE
from tests.unit.field.test_learning import SCENE, ball_frame

FOLDER = Path("out/benchmarks/captures")
OUT = Path("out/benchmarks/captures.json")
FOX = Path(__file__).parents[2] / "shared" / "captures" / "fox"
FRAMES = 3
SPEC: dict[str, Any] = {
    "reconstruction": {
        "region": {"min_m": SCENE.low.tolist(), "max_m": SCENE.high.tolist()},
        "voxel_m": 0.04,
        "iterations": 400,
        "fine_tune_iterations": 80,
        "rays_per_batch": 2048,
        "points": 4000,
    }
}
SOLVED_AT = 2
"""The fox's pictures are halved before they are solved."""


def format_rows() -> Iterator[Row]:
    """Distance of every format's clouds to those of transforms.json, over that of another seed."""
    films = written_films()
    first = reconstructed("transforms", films["transforms"], seed=0)
    noise = cloud_distance(first, reconstructed("transforms", films["transforms"], seed=1))
    yield Row(what="median distance of clouds, two seeds: the noise", value=1e3 * noise, unit="mm", floor=20, aim=10)
    for kind in reversed(films):
        if kind != "transforms":
            distance = cloud_distance(first, reconstructed(kind, films[kind], seed=0))
            yield Row(what=f"{kind}: distance over the noise", value=distance / noise, unit="x", floor=1.2, aim=1.05)
    served = through_the_service(films["rig and videos"])
    distance = cloud_distance(first, served)
    yield Row(
        what="rig and videos, through the API: distance over the noise",
        value=distance / noise,
        unit="x",
        floor=1.2,
        aim=1.05,
    )


def written_films() -> dict[str, Path]:
    """The film in every format; made once."""
    folders = {kind: FOLDER / "films" / kind.replace(" ", "_") for kind in FORMATS if kind != "colmap text"}
    if not all(folder.is_dir() for folder in folders.values()):
        film = moving_ball()
        for kind, folder in folders.items():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            FORMATS[kind](folder, film)
    return folders


def moving_ball() -> list[Frame]:
    """The ball at rest and at two other places."""
    places = [[0.0, 0.0, 0.75], [0.08, 0.0, 0.83], [0.02, 0.1, 0.7]]
    return [replace(ball_frame(k, np.array(place)), time=k / RATE) for k, place in enumerate(places)]


def reconstructed(kind: str, folder: Path, *, seed: int) -> list[np.ndarray]:
    """Points of every frame by `nerfmodal reconstruct`."""
    spec = FOLDER / f"spec_{seed}.yaml"
    spec.write_text(yaml.safe_dump({**document(folder, kind), "seed": seed}))
    out = FOLDER / f"{kind.replace(' ', '_')}_{seed}"
    shutil.rmtree(out, ignore_errors=True)
    told = [] if kind in FILMED else ["--frame-rate", str(RATE)]
    command = ["reconstruct", str(folder), "--spec", str(spec), "--out", str(out), *told]
    done = CliRunner().invoke(app, command)
    if done.exit_code:
        raise SystemExit(f"nerfmodal {' '.join(command)}: {done.output}")
    return [io.read_cloud(out / f"frame_{k:04d}.ply").points for k in range(FRAMES)]


def document(folder: Path, kind: str) -> dict[str, Any]:
    """The specification of a capture."""
    source: dict[str, Any] = {"kind": "capture", "path": str(folder.resolve())}
    return {"name": "film", "source": source if kind in FILMED else source | {"frame_rate_hz": RATE}, **SPEC}


def through_the_service(folder: Path) -> list[np.ndarray]:
    """The same by a scan over HTTP."""
    from scanclient import Client

    data, out = FOLDER / "service", FOLDER / "served"
    for old in (data, out):
        shutil.rmtree(old, ignore_errors=True)
    spec = ScanSpec.model_validate(document(folder, "rig and videos"))
    with (
        running_service(data, FOLDER / "service.log", [folder.resolve().parent]) as service,
        Client(service.address, timeout_s=60.0) as client,
    ):
        scan = client.submit(spec.model_dump(mode="json"))
        client.wait(scan.id, poll_s=1.0)
        files = client.download(scan.id, out, select=lambda one: one.name.startswith("clouds/"))
    return [io.read_cloud(path).points for path in sorted(files)]


def cloud_distance(a: list[np.ndarray], b: list[np.ndarray]) -> float:
    """Median over all points of both of the distance to the nearest of the other (m), mean over the frames that moved.

    Frame 0 is left out: of a capture (whose ground is not known) it is empty after so short a training.
    """
    both = [(cKDTree(one), cKDTree(other)) for one, other in zip(a[1:], b[1:], strict=True)]
    return float(np.mean([np.median(np.r_[x.query(y.data)[0], y.query(x.data)[0]]) for x, y in both]))


def pose_rows() -> Iterator[Row]:
    """The fox solved anew."""
    if not FOX.is_dir():
        print("the fox is left out: ../shared/captures/fox is not here", file=sys.stderr)
        return
    folder = FOLDER / "fox"
    if not folder.is_dir():
        write_halved(folder)
    given = {one.name: one for one in open_capture(CaptureSource(kind="capture", path=str(FOX))).rig.cameras}
    source = CaptureSource(kind="capture", path=str(folder), one_lens=True)
    solved = open_capture(source, FOLDER / "fox_solved", lambda what: print(what, file=sys.stderr)).rig.cameras
    true = np.array([given[f"{one.name}.jpg"].camera_to_world[:3, 3] for one in solved])
    found = np.array([one.camera_to_world[:3, 3] for one in solved])
    scale, rotation, shift = similarity(found, true)
    miss = np.linalg.norm(scale * found @ rotation.T + shift - true, axis=1)
    radius = float(np.linalg.norm(true - true.mean(axis=0), axis=1).mean())
    focal = SOLVED_AT * solved[0].focal_x / next(iter(given.values())).focal_x - 1
    yield Row(what="fox: cameras solved", value=len(solved), unit="of 50", floor=45, aim=50)
    yield Row(what="fox: focal length", value=100 * abs(focal), unit="%", floor=1, aim=0.1)
    yield Row(
        what="fox: camera centres, median", value=100 * float(np.median(miss)) / radius, unit="%", floor=1, aim=0.2
    )
    yield Row(what="fox: camera centres, worst", value=100 * float(miss.max()) / radius, unit="%", floor=2, aim=0.5)


def write_halved(folder: Path) -> None:
    """The fox's pictures, half as large, without their poses."""
    from nerfmodal.io.frames import encode_png

    frame = open_capture(CaptureSource(kind="capture", path=str(FOX))).read(0, SOLVED_AT)
    folder.mkdir(parents=True)
    for camera, image in zip(frame.rig.cameras, frame.images, strict=True):
        (folder / f"{Path(camera.name).stem}.png").write_bytes(encode_png(image))


GROUPS: dict[str, Callable[[], Iterator[Row]]] = {"formats": format_rows, "poses": pose_rows}


def main() -> None:
    """Run the groups asked for, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(GROUPS), default=list(GROUPS))
    arguments = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for group in arguments.only:
        for row in GROUPS[group]():
            print(row.line(), flush=True)
            rows.append(row)
    OUT.write_text(json.dumps(beside_earlier([row.as_json() for row in rows]), indent=1))


def beside_earlier(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """These rows after those of groups that ran earlier."""
    earlier = json.loads(OUT.read_text()) if OUT.is_file() else []
    measured = {row["what"] for row in rows}
    return [row for row in earlier if row["what"] not in measured] + rows


if __name__ == "__main__":
    main()
