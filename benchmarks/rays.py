"""Training speed against the machine's own limits (roofline, Williams et al. 2009), and memory at the paper's size."""

import multiprocessing
import resource
from collections.abc import Iterator
from time import perf_counter
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Int
from nerfmodal import pipeline
from nerfmodal.field import corners, grid, marching
from nerfmodal.field.backgrounds import remaining, stride
from nerfmodal.field.course import Course
from nerfmodal.field.grid import grid_of
from nerfmodal.field.grid_training import focused, plant_pixels
from nerfmodal.field.views import CELL, Views, pixels_at, views_of
from nerfmodal.types import Camera, Frame, Rig

from benchmarks.films import Film, palm
from benchmarks.geometry import silent
from benchmarks.rows import Row

RAYS = 4096
BATCHES = 50
TIMES = 5
"""The best of so many counts, of the loop as of the triad and the multiply-adds: the machine works for others too."""
BYTES_PER_SAMPLE = 8 * 16 * 3
"""Eight corners of four floats: gathered, and their gradients read and written."""
BYTES_PER_LINE = corners.LINE * 16 * (2 + 2 + 4)
"""Adam at every line of vertices that a batch touched: values, gradients and two moments, read and written."""
FLOPS_PER_SAMPLE = 8 * (4 * 2 * 2 + 6) + 60
"""Eight corners' weights, multiply-adds forward and backward; compositing and its derivative."""
ENLARGED = 8
GIBIBYTE = 2**30


def roofline_rows(film: Film) -> Iterator[Row]:
    """Rays per second of the finest level's training loop, as a share of what memory or arithmetic would allow."""
    first = film.frame(0)
    views = views_of(first)
    state = pipeline.fit_first(film.spec, first, report=silent).state
    field = grid_of(state)
    rng = np.random.default_rng(0)
    plant = plant_pixels(remaining(field, views, stride(views)), views)
    draw = focused(plant, views, RAYS, rng)
    samples, lines = np.mean([_met(field, views, draw()) for _ in range(16)], axis=0)

    def train() -> float:
        draws = iter([draw() for _ in range(BATCHES)])
        course = Course(BATCHES, lambda _done, _of, _message: None)
        began = perf_counter()
        grid.train(field, views, state["backgrounds"], lambda: next(draws), BATCHES, rng, course, rates=grid.Rates())
        return perf_counter() - began

    train()
    rate = BATCHES * RAYS / min(train() for _ in range(TIMES))
    bandwidth, arithmetic = _bandwidth(), _arithmetic()
    moved = samples * BYTES_PER_SAMPLE + lines * BYTES_PER_LINE
    limit = min(bandwidth / moved, arithmetic / (samples * FLOPS_PER_SAMPLE))
    print(
        f"  {rate / 1e3:.0f}k rays/s of {samples:.1f} samples on {numba.get_num_threads()} threads; bytes a ray: "
        f"{samples * BYTES_PER_SAMPLE:.0f} at its samples, {lines * BYTES_PER_LINE:.0f} by the optimiser; the machine: "
        f"{bandwidth / 1e9:.1f} GB/s, {arithmetic / 1e9:.1f} Gflop/s"
    )
    yield Row(what="training rays per second against the roofline", value=rate / limit, unit="", floor=0.15, aim=0.5)


def memory_rows(film: Film) -> Iterator[Row]:
    """Peak memory of a process that trains frame 0, then a further frame, and extracts it."""
    del film
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        peak = pool.apply(_peak_of_full_size)
    yield Row(what="peak memory at 50 views of 1920x1080", value=peak / GIBIBYTE, unit="GiB", floor=4, aim=2)


def _peak_of_full_size() -> float:
    small = Film(spec=palm(views=50, frames=2, width=1920 // ENLARGED, height=1080 // ENLARGED))
    first, second = (_enlarged(small.frame(index)) for index in range(2))
    few = small.spec.reconstruction.model_copy(update={"iterations": 100})
    spec = small.spec.model_copy(update={"reconstruction": few})
    parent = pipeline.fit_first(spec, first, report=silent)
    tuned = pipeline.fine_tune(spec, parent, first, second, report=silent)
    pipeline.extract(spec, tuned, second, report=silent)
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _enlarged(frame: Frame) -> Frame:
    images = frame.images.repeat(ENLARGED, axis=1).repeat(ENLARGED, axis=2)
    rig = Rig(cameras=tuple(_larger(camera) for camera in frame.rig.cameras))
    return Frame(index=frame.index, time=frame.time, images=images, rig=rig)


def _larger(camera: Camera) -> Camera:
    return Camera(
        name=camera.name,
        width=camera.width * ENLARGED,
        height=camera.height * ENLARGED,
        focal_x=camera.focal_x * ENLARGED,
        focal_y=camera.focal_y * ENLARGED,
        center_x=camera.center_x * ENLARGED,
        center_y=camera.center_y * ENLARGED,
        camera_to_world=camera.camera_to_world,
    )


def _met(field: grid.GridField, views: Views, flat: Int[np.ndarray, " rays"]) -> tuple[float, float]:
    """Samples, and lines of vertices that they touch, of a batch: for each of its rays."""
    bricks = field.bricks
    touched = np.zeros(len(field.values) // corners.LINE, np.uint8)
    samples = _count(
        bricks.slots,
        bricks.masks,
        field.values,
        field.half,
        bricks.low,
        bricks.voxel,
        views.table,
        views.poses,
        views.nears,
        pixels_at(flat, views.images.shape),
        np.empty_like(field.values),
        touched,
    )
    return samples / len(flat), float(touched.sum()) / len(flat)


@numba.njit
@no_type_check
def _count(slots, masks, values, half, low, voxel, table, poses, nears, pixels, gradient, touched):
    rows = np.empty((marching.MAX_SAMPLES, 8), np.int32)
    offsets = np.empty((marching.MAX_SAMPLES, 3), np.float32)
    samples, lanes = np.empty((marching.MAX_SAMPLES, 8), np.float32), np.zeros((3, marching.AT_ONCE), np.float32)
    four = (np.float32(0), np.float32(0), np.float32(0), np.float32(0))
    total = 0
    for ray in range(len(pixels)):
        camera, row, column = pixels[ray]
        dx, dy, dz = marching.ray_of(table, poses, camera, row, column, CELL)
        x, y, z = poses[camera, 0, 3] - low[0], poses[camera, 1, 3] - low[1], poses[camera, 2, 3] - low[2]
        n, _, _ = marching.march_inner(
            slots, masks, values, half, voxel, x / voxel, y / voxel, z / voxel, dx, dy, dz, nears[camera] / voxel,
            grid.STEP, 0.5, rows, offsets, samples, lanes,
        )  # fmt: skip
        for index in range(n):
            corners.tell(gradient, touched, rows, offsets, index, four)
        total += n
    return total


def _bandwidth(megabytes: int = 256, times: int = TIMES) -> float:
    """Bytes per second of a[i] = b[i] + s c[i] (STREAM's triad, McCalpin 1995), the best of several."""
    a, b, c = (np.ones(megabytes * 2**20 // 8) for _ in range(3))
    _triad(a, b, c)
    return max(3 * a.nbytes / _timed(_triad, a, b, c) for _ in range(times))


def _arithmetic(rounds: int = 200_000, times: int = TIMES) -> float:
    """Single-precision operations per second of independent multiply-adds, the best of several.

    Nothing decays to numbers too small to be normal, which a processor multiplies a hundred times more slowly.
    """
    threads = numba.get_num_threads()
    _multiply_add(rounds, threads)
    return max(threads * rounds * 64 * 2 / _timed(_multiply_add, rounds, threads) for _ in range(times))


def _timed(work, *arguments) -> float:  # type: ignore[no-untyped-def]
    began = perf_counter()
    work(*arguments)
    return perf_counter() - began


@numba.njit(parallel=True, fastmath=True)
@no_type_check
def _triad(a, b, c):
    for index in numba.prange(len(a)):
        a[index] = b[index] + 3.0 * c[index]


@numba.njit(parallel=True, fastmath=True)
@no_type_check
def _multiply_add(rounds, threads):
    sums = np.zeros(threads)
    for thread in numba.prange(threads):
        lanes = np.arange(64).astype(np.float32)
        factor, term = np.float32(0.999), np.float32(1e-3 * (thread + 1))
        for _ in range(rounds):
            for lane in range(64):
                lanes[lane] = lanes[lane] * factor + term
        sums[thread] = lanes.sum()
    return sums.sum()
