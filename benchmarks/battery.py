"""Cases of the same kind as the public ones: more modes, closer ones, uneven time, large swings, other lengths.

A row a case: the share of its seeds whose modes are all found, none too many, each within four stated deviations (or
0.2 % of the frequency, or 0.2 percentage points of damping) and with the MAC that the case allows.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from nerfmodal.identify import identify_scan
from nerfmodal.identify.comparison import compare
from nerfmodal.spec import IdentificationSpec, OrganSpec
from nerfmodal.surface import measure_organ
from nerfmodal.types import PointCloud, ScanResult, TrueMode, Verdict

from benchmarks.rows import Row
from tests.fixtures.moving_clouds import Flaws, Mode, Scene, Trunk, leaf_clouds, trunk_clouds
from tests.fixtures.public_cases import scan_result

SDS, SHARE, POINTS = 4.0, 0.002, 0.002
THREE = (
    Mode(shape="bending_1", frequency=2.17, damping=0.01, amplitude=0.03),
    Mode(shape="bending_2", frequency=4.83, damping=0.01, amplitude=0.015, phase=1.1),
    Mode(shape="torsion_1", frequency=9.61, damping=0.01, amplitude=0.012, phase=2.0),
)
FOUR = (*THREE, Mode(shape="bending_3", frequency=12.73, damping=0.005, amplitude=0.008, phase=0.2))
FIVE = (*FOUR, Mode(shape="bending_with_twist", frequency=7.19, damping=0.012, amplitude=0.01, phase=2.6))
SIX = (*FIVE, Mode(shape="torsion_1", frequency=3.37, damping=0.008, amplitude=0.012, phase=1.7))
CLOSE = (
    Mode(shape="bending_1", frequency=3.03, damping=0.008, amplitude=0.02),
    Mode(shape="bending_with_twist", frequency=3.29, damping=0.01, amplitude=0.02, phase=1.9),
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, how it is sampled, and the lowest MAC of its modes."""

    name: str
    scene: Scene | Trunk
    mac: float = 0.98
    frame_rate: float = 30.0
    jitter: float = 0.0
    lost: float = 0.0


def at(rate: float, frames: int, modes: tuple[Mode, ...]) -> Scene:
    """A scene of so many frames, its modes at the same share of the frame rate as at 30 frames/s."""
    moved = tuple(replace(mode, frequency=mode.frequency * rate / 30.0) for mode in modes)
    return Scene(modes=moved, times=np.arange(frames) / rate, points=2000, flaws=Flaws(bias=0.0005))


MILD = Flaws(bias=0.0005)
BENT = Mode(shape="bending_1", frequency=1.07, amplitude=0.02)
CASES = (
    Case(name="four modes", scene=Scene(modes=FOUR, points=2000, flaws=MILD), mac=0.95),
    Case(name="five modes, shapes not orthogonal", scene=Scene(modes=FIVE, points=2000, flaws=MILD), mac=0.9),
    Case(name="six modes", scene=Scene(modes=SIX, points=2000, flaws=MILD), mac=0.9),
    Case(name="two modes 0.26 Hz apart, MAC 0.5", scene=Scene(modes=CLOSE, points=2000, flaws=MILD)),
    Case(
        name="uneven stamps, 15 % lost or empty",
        scene=Scene(modes=THREE, points=2000, flaws=MILD),
        jitter=0.012,
        lost=0.15,
    ),
    Case(
        name="swing of 12 cm with true rotation",
        scene=Scene(modes=(replace(THREE[0], amplitude=0.12), THREE[2]), points=2000, flaws=MILD, rotating=True),
        mac=0.95,
    ),
    Case(
        name="pitched 70 degrees, rolled 40",
        scene=Scene(modes=THREE, points=2000, flaws=MILD, yaw=77.0, pitch=-70.0, roll=40.0, translation=(4, -2, 1)),
        mac=0.95,
    ),
    Case(name="24 frames", scene=at(30.0, 24, THREE[1:]), mac=0.95),
    Case(name="48 frames at 15 frames/s", scene=at(15.0, 48, THREE), mac=0.95, frame_rate=15.0),
    Case(name="300 frames at 120 frames/s", scene=at(120.0, 300, THREE), frame_rate=120.0),
    Case(name="600 frames, undamped", scene=at(30.0, 600, tuple(replace(mode, damping=0.0) for mode in THREE))),
    Case(name="damping 8 %", scene=Scene(modes=tuple(replace(mode, damping=0.08) for mode in THREE[:2]), points=2000)),
    Case(
        name="trunk bending at 35 degrees, a third of it seen",
        scene=Trunk(modes=(BENT,), points=2500, bending=35.0, seen_degrees=120.0),
    ),
    Case(
        name="trunk with two modes",
        scene=Trunk(modes=(BENT, replace(BENT, shape="bending_2", frequency=4.41, amplitude=0.01)), points=2500),
    ),
)


def battery_rows(seeds: int) -> Iterator[Row]:
    """A row a case, over a quarter of the seeds."""
    for case in CASES:
        right = [not faults(case, seed) for seed in range(max(1, seeds // 4))]
        yield Row(what=f"{case.name}: all modes right", value=np.mean(right), unit="-", floor=0.8, aim=1.0)


def faults(case: Case, seed: int) -> list[str]:
    """What is wrong with the modes found, in words."""
    result, truth = identify_case(case, seed)
    rows = [row for row in compare(result, truth) if row.verdict is Verdict.ACCEPTED or row.truth_hz is not None]
    model, found = result.organs[0].model, []
    for row in rows:
        if row.truth_hz is None or row.found_hz is None or row.verdict is not Verdict.ACCEPTED:
            found.append(f"{row.truth_hz} Hz was read as {row.found_hz} ({row.verdict})")
            continue
        place = int(np.argmin(np.abs(model.frequencies - row.found_hz)))
        frequency = max(SDS * model.frequency_stds[place], SHARE * row.truth_hz)
        damping = max(SDS * model.damping_stds[place], POINTS)
        if abs(row.found_hz - row.truth_hz) > frequency:
            found.append(f"{row.truth_hz} Hz was read as {row.found_hz:.4f}, {frequency:.4f} allowed")
        if abs((row.found_damping or 0) - (row.truth_damping or 0)) > damping:
            found.append(f"{row.truth_hz} Hz: damping {row.found_damping}, {damping:.4f} allowed")
        if (row.mac or 0) < case.mac:
            found.append(f"{row.truth_hz} Hz: MAC {row.mac:.3f}")
    return found


def identify_case(case: Case, seed: int) -> tuple[ScanResult, list[TrueMode]]:
    """What is made of the case's clouds, and the truth."""
    rng = np.random.default_rng(seed)
    times = case.scene.times + rng.uniform(-case.jitter, case.jitter, len(case.scene.times))
    modes = tuple(replace(mode, phase=rng.uniform(0, 2 * np.pi)) for mode in case.scene.modes)
    drawn, truth = _draw(replace(case.scene, times=times, modes=modes), seed)
    clouds: list[PointCloud | None] = list(drawn)
    for place in np.flatnonzero(rng.random(len(clouds)) < case.lost):
        clouds[place] = None if place % 2 else replace(drawn[place], points=np.zeros((0, 3)), colors=np.zeros((0, 3)))
    surface = "cylinder" if isinstance(case.scene, Trunk) else "polynomial"
    organs = identify_scan(
        (OrganSpec(name=truth[0].organ, surface=surface, sensors=300),),
        IdentificationSpec(),
        clouds,
        measure=measure_organ,
        frame_rate=case.frame_rate,
        times=times,
        seed=seed,
        report=lambda _done, _total, _message: None,
    )
    return scan_result(organs, times), truth


def _draw(scene: Scene | Trunk, seed: int) -> tuple[list[PointCloud], list[TrueMode]]:
    return trunk_clouds(scene, seed) if isinstance(scene, Trunk) else leaf_clouds(scene, seed)
