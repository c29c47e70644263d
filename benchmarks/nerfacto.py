"""Time to the same held-out PSNR on a CPU, against nerfstudio's nerfacto: `python -m benchmarks.nerfacto --python …`.

Two scenes: the fox (photographs, 270 x 480, every 8th view held out) and frame 0 of the simulated palm (200 x 200,
every 9th). Both sides train on the same pictures and are measured on the same pixels of the same held-out pictures.
nerfacto trains for `--seconds`; ours is fitted anew with more and more iterations until it reaches the PSNR that
nerfacto had at the end. Times are CPU seconds of the process, so that neighbours matter little: with one thread,
seconds of one core. They end with the last step of training: compiling (numba), evaluating, and the still backgrounds
that ours paints for further frames are left out.

nerfacto takes `--rays` a step, 256 by default. Of its own 4,096 a core does one step in ten seconds: in the minutes
that one can wait it learns more from many small steps, so that this is the kinder setting. For the same reason ours
takes 1,024 a step on the fox; on the palm, where it takes eight steps in all, its own 4,096.

nerfstudio lives in an environment of its own (it pins much): `make nerfstudio`, or by hand

    python3.11 -m venv out/nerfstudio && out/nerfstudio/bin/pip install nerfstudio

What nerfacto did is kept under out/benchmarks/nerfacto: a further run with more `--seconds` goes on from there.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numba
import numpy as np
from jaxtyping import Float, Int
from nerfmodal import capture, pipeline
from nerfmodal.field import grid
from nerfmodal.field.course import psnr
from nerfmodal.field.grid import grid_of
from nerfmodal.field.views import views_of
from nerfmodal.geometry.cameras import focus_of
from nerfmodal.io.transforms import camera_entry
from nerfmodal.spec import CaptureSource, ReconstructionSpec, ScanSpec
from nerfmodal.types import Checkpoint, Frame
from PIL import Image
from threadpoolctl import threadpool_limits

from benchmarks.films import Film, palm
from benchmarks.rows import Row

OUT = Path("out/benchmarks")
FOX = Path("../shared/captures/fox")
PYTHON = Path("out/nerfstudio/bin/python")
RUNNER = Path(__file__).with_name("nerfacto_runner.py")
PATCH, PATCHES = 8, 15
"""Held-out pixels come in squares of so many pixels a side, and about so many of them in each picture."""
FOX_RAYS = 1024
"""Of our steps on the fox."""
FEWEST, GROWTH, MOST = 8, 1.5, 6000
"""Iterations of our shortest fit, of each further one relative to the last, and of the longest."""
WARM_UP = 12
LATE = 1.1
"""A run that was meant to end at some time may have ended so much later."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A scene, the pictures to learn and those to be compared in `pixels` (view, row, column)."""

    name: str
    spec: ScanSpec
    learned: Frame
    held_out: Frame
    pixels: Int[np.ndarray, "pixels 3"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """How good a field was after so many CPU seconds of training with so many rays."""

    seconds: float
    psnr: float
    rays: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """How nerfacto trains: CPU seconds, rays a step, threads (ours has as many)."""

    seconds: float = 900
    rays: int = 256
    threads: int = 1


def fox_task() -> Task:
    """The photographs of the fox, four times smaller than they are."""
    source = CaptureSource(kind="capture", path=str(FOX), downscale=4)
    spec = ScanSpec(name="fox", source=source, reconstruction=ReconstructionSpec(rays_per_batch=FOX_RAYS))
    return _task(spec, pipeline.make_frame(spec, 0, report=lambda _progress: None), 8)


def palm_task() -> Task:
    """The simulated palm at rest."""
    film = Film(spec=palm(0.05))
    return _task(film.spec, film.frame(0), 9)


TASKS: dict[str, Callable[[], Task]] = {"fox": fox_task, "palm": palm_task}


def _task(spec: ScanSpec, frame: Frame, every: int) -> Task:
    learned, held_out = capture.split_held_out(frame, every)
    assert held_out is not None
    return Task(
        name=spec.name, spec=spec, learned=learned, held_out=held_out, pixels=compared_pixels(held_out.images.shape)
    )


def compared_pixels(shape: tuple[int, ...]) -> Int[np.ndarray, "pixels 3"]:
    """Squares of pixels spread evenly over pictures of `shape` (views, height, width, 3)."""
    views, height, width, _ = shape
    spacing = np.sqrt(height * width / PATCHES)
    rows, columns = (_starts(side, round(side / spacing)) for side in (height, width))
    axes = np.arange(views), rows, np.arange(PATCH), columns, np.arange(PATCH)
    view, top, down, left, right = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    return np.stack([view, top + down, left + right], axis=1)


def _starts(side: int, count: int) -> Int[np.ndarray, " count"]:
    return np.round((np.arange(count) + 0.5) * side / count - PATCH / 2).astype(int)


def write_capture(task: Task, folder: Path) -> None:
    """Write what nerfacto trains on and is measured by.

    The world is moved and scaled once, here: the point that the cameras look at becomes the origin and the cameras lie
    within [-1, 1], which is the part of space that nerfacto does not contract.
    """
    (folder / "images").mkdir(parents=True, exist_ok=True)
    center, _ = focus_of(task.learned.rig)
    cameras = task.learned.rig.cameras + task.held_out.rig.cameras
    reach = max(float(np.abs(camera.camera_to_world[:3, 3] - center).max()) for camera in cameras)
    names: dict[str, list[str]] = {"train": [], "val": []}
    frames = []
    for split, frame in (("train", task.learned), ("val", task.held_out)):
        for index, (camera, image) in enumerate(zip(frame.rig.cameras, frame.images, strict=True)):
            file = f"images/{split}_{index:03d}.png"
            pose = camera.camera_to_world.copy()
            pose[:3, 3] = (pose[:3, 3] - center) / reach
            frames.append(camera_entry(camera) | {"file_path": file, "transform_matrix": pose.tolist()})
            names[split].append(file)
            Image.fromarray(image).save(folder / file)
    top = {"camera_model": "OPENCV", "frames": frames}
    top |= {"train_filenames": names["train"], "val_filenames": names["val"], "test_filenames": names["val"]}
    (folder / "transforms.json").write_text(json.dumps(top, indent=1))
    np.save(folder / "held_out.npy", task.pixels)


def theirs(python: Path, task: Task, setting: Setting) -> list[Moment]:
    """What nerfacto reached, and when; goes on where an earlier run with the same setting stopped."""
    folder = OUT / "nerfacto" / f"{task.name}_{setting.rays}x{setting.threads}"
    write_capture(task, folder)
    log = folder / "moments.jsonl"
    known = read_moments(log)
    if not known or known[-1].seconds < setting.seconds:
        command = [python, RUNNER, folder, "--state", folder / "state.pt", "--seconds", setting.seconds]
        command += ["--rays", setting.rays, "--threads", setting.threads]
        environment = os.environ | {"OMP_NUM_THREADS": f"{setting.threads}"}
        with log.open("a") as lines, (folder / "nerfstudio.log").open("a") as said:
            subprocess.run([str(part) for part in command], stdout=lines, stderr=said, env=environment, check=True)
    return [moment for moment in read_moments(log) if moment.seconds <= LATE * setting.seconds]


def read_moments(log: Path) -> list[Moment]:
    """The runner's lines; what nerfstudio itself prints is passed over, and what a stopped run lost again."""
    lines = log.read_text().splitlines() if log.exists() else []
    moments: list[Moment] = []
    for one in (json.loads(line) for line in lines if line.startswith("{")):
        while moments and moments[-1].seconds >= one["seconds"]:
            moments.pop()
        moments.append(Moment(seconds=one["seconds"], psnr=one["psnr"], rays=one["rays"]))
    return moments


def ours(task: Task, target: float) -> list[Moment]:
    """Fits with more and more iterations, up to the first that reaches `target` dB; each from nothing."""
    moments: list[Moment] = []
    iterations = float(FEWEST)
    fitted(task, WARM_UP)
    while iterations <= MOST and (not moments or moments[-1].psnr < target):
        count = round(iterations)
        checkpoint, seconds = fitted(task, count)
        rays = count * task.spec.reconstruction.rays_per_batch
        moments.append(Moment(seconds=seconds, psnr=held_out_psnr(task, checkpoint), rays=rays))
        iterations *= GROWTH
    return moments


def fitted(task: Task, iterations: int) -> tuple[Checkpoint, float]:
    """Our field after so many iterations, all else by default, and the CPU seconds up to the last iteration.

    As it is where frames are refitted: a reference that is followed is trained for longer than it is asked to.
    """
    reconstruction = task.spec.reconstruction.model_copy(update={"iterations": iterations, "motion": "refit"})
    spec = task.spec.model_copy(update={"reconstruction": reconstruction})
    clock = [time.process_time()]
    checkpoint = pipeline.fit_first(spec, task.learned, report=lambda _progress: clock.append(time.process_time()))
    return checkpoint, clock[-1] - clock[0]


def held_out_psnr(task: Task, checkpoint: Checkpoint) -> float:
    """Of the pixels that are compared, dB."""
    shown = painted(checkpoint, task.held_out, task.pixels)
    view, row, column = task.pixels.T
    return psnr(float(np.mean((shown - task.held_out.images[view, row, column] / 255.0) ** 2)))


def painted(checkpoint: Checkpoint, frame: Frame, pixels: Int[np.ndarray, "pixels 3"]) -> Float[np.ndarray, "pixels 3"]:
    """Colours in [0, 1] of pixels (view, row, column), with what lies beyond the region."""
    front, left, behind, _, _ = grid.render(
        grid_of(checkpoint.state), views_of(frame), pixels.astype(np.int32), behind=True
    )
    return np.clip(front + left[:, None] * behind, 0.0, 1.0)


def time_to_reach(curve: Sequence[Moment], target: float) -> float | None:
    """Seconds at which a curve first reaches `target` dB, straight between its moments; None when it never does."""
    if not curve or max(moment.psnr for moment in curve) < target:
        return None
    if curve[0].psnr >= target:
        return curve[0].seconds
    before, after = next((a, b) for a, b in pairwise(curve) if b.psnr >= target)
    part = (target - before.psnr) / (after.psnr - before.psnr)
    return before.seconds + part * (after.seconds - before.seconds)


def speed_up(their_curve: Sequence[Moment], our_fits: Sequence[Moment]) -> float:
    """Their time over ours to the last PSNR of theirs; 0 when ours never reaches it.

    Ours is the whole time of the first fit that got there: its schedule depends on where it ends, so that there is
    nothing to read between two fits.
    """
    target = their_curve[-1].psnr
    their_time = time_to_reach(their_curve, target)
    enough = [moment for moment in our_fits if moment.psnr >= target]
    return their_time / enough[0].seconds if enough and their_time is not None else 0.0


def nerfacto_rows(python: str | None, seconds: float) -> Iterator[Row]:
    """The speed-up in both scenes on one thread; see `rows_of`."""
    return rows_of(python, Setting(seconds=seconds))


def rows_of(python: str | None, setting: Setting) -> Iterator[Row]:
    """The speed-up in both scenes; nothing but a word on stderr where nerfstudio's environment is missing."""
    place = Path(python) if python else PYTHON
    if not place.exists():
        print(f"nerfacto is left out: {place} does not exist; type: make nerfstudio", file=sys.stderr)
        return
    numba.set_num_threads(setting.threads)
    with threadpool_limits(setting.threads, user_api="blas"):  # its threads would spin beside the one that works
        for name, make in TASKS.items():
            if name == "fox" and not FOX.exists():
                print(f"the fox is left out: {FOX} does not exist", file=sys.stderr)
                continue
            yield _row(make(), place, setting)


def _row(task: Task, python: Path, setting: Setting) -> Row:
    their_curve = theirs(python, task, setting)
    last = their_curve[-1]
    our_fits = ours(task, last.psnr)
    for who, curve in (("nerfacto", their_curve), ("ours", our_fits)):
        print(f"  {task.name}, {who}: " + ", ".join(f"{one.psnr:.2f} dB after {one.seconds:.3g} s" for one in curve))
    rate = last.rays / last.seconds
    print(f"  nerfacto, {setting.threads} thread(s): {rate:.0f} rays/s, {setting.rays / rate:.2f} s a step", flush=True)
    what = f"{task.name}: nerfacto's time to its {last.psnr:.1f} dB after {last.seconds:.0f} s, over ours"
    return Row(what=what, value=speed_up(their_curve, our_fits), unit="x", floor=100, aim=1000)


def main() -> None:
    """Print the rows and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", help=f"of the environment with nerfstudio; default {PYTHON}")
    parser.add_argument("--seconds", type=float, default=900, help="of nerfacto's training, per scene")
    parser.add_argument("--rays", type=int, default=256, help="of nerfacto's steps")
    parser.add_argument("--threads", type=int, default=1, help="of both sides")
    arguments = parser.parse_args()
    setting = Setting(seconds=arguments.seconds, rays=arguments.rays, threads=arguments.threads)
    rows = []
    for row in rows_of(arguments.python, setting):
        print(row.line(), flush=True)
        rows.append(row.as_json())
    if rows:
        (OUT / "nerfacto.json").write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
