"""What real cameras do to pictures and to what is told of them. Seeded: nothing depends on the order of rendering.

Shutters act on light before the sensor (see `filming`); here is what comes after: exposure, electrons, white balance.
Noise is that of a photon transfer curve (EMVA 1288): the variance of a pixel is its mean in electrons plus read noise².
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from nerfmodal.simulate.stage import subpixels
from nerfmodal.spec import SensorSpec
from nerfmodal.types import Camera, Rig

GAINS, NOISE, JITTER, CALIBRATION = range(4)
"""What a stream of random numbers is for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """A part of a picture: the rows `first` to `end` - 1 at `offset` seconds from the frame's time, of this `share`.

    `shift` (pixels, x and y) is where in its pixels it looks, so that what stands still is smooth in the sum.
    """

    offset: float
    first: int
    end: int
    share: float
    shift: tuple[float, float] = (0.0, 0.0)


def exposures(sensor: SensorSpec, view: int, frame: int, rows: int) -> tuple[Exposure, ...]:
    """What the picture of camera number `view` in `frame` is made of."""
    late = sensor.jitter_s * float(_random(sensor, JITTER, view, frame).normal())
    bands = _bands(rows, sensor.instants if sensor.rolling_shutter_s else 1)
    moments = sensor.instants if sensor.shutter_s else 1
    shifts = subpixels(moments)
    return tuple(
        Exposure(
            offset=late
            + sensor.rolling_shutter_s * ((first + end) / 2 / rows - 0.5)
            + sensor.shutter_s * ((moment + 0.5) / moments - 0.5),
            first=first,
            end=end,
            share=1 / moments,
            shift=(float(shifts[moment, 0]), float(shifts[moment, 1])),
        )
        for first, end in bands
        for moment in range(moments)
    )


def is_perfect(sensor: SensorSpec) -> bool:
    """Whether pixels are what the renderer says."""
    return sensor.full_well_e is None and not (sensor.exposure_spread_ev or sensor.white_balance_spread)


def sensed(
    light: Float[np.ndarray, "height width 3"], sensor: SensorSpec, view: int, frame: int
) -> Float[np.ndarray, "height width 3"]:
    """Linear values that a camera makes of linear light, where 1 is white: not below 0, nor above a full well."""
    constant = _random(sensor, GAINS, view, 0)
    exposure = 2.0 ** (sensor.exposure_spread_ev * constant.normal())
    red, blue = np.exp(sensor.white_balance_spread * constant.normal(size=2))
    values = light * exposure
    if sensor.full_well_e is not None:
        noise = _random(sensor, NOISE, view, frame)
        electrons = noise.poisson(np.clip(values, 0, None) * sensor.full_well_e).astype(float)
        electrons += sensor.read_noise_e * noise.normal(size=electrons.shape)
        values = electrons / sensor.full_well_e
    return np.clip(values, 0.0, 1.0) * np.array([red, 1.0, blue])


def told_rig(rig: Rig, sensor: SensorSpec) -> Rig:
    """The rig as its calibration tells it: the true one with errors of pose and focal length."""
    return Rig(cameras=tuple(_told(camera, sensor, view) for view, camera in enumerate(rig.cameras)))


def _told(camera: Camera, sensor: SensorSpec, view: int) -> Camera:
    random = _random(sensor, CALIBRATION, view, 0)
    shift, turn, focal = random.normal(size=3), random.normal(size=3), random.normal()
    pose = camera.camera_to_world.copy()
    pose[:3, 3] += sensor.position_error_m * shift
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(np.radians(sensor.rotation_error_deg) * turn).as_matrix()
    scale = 1 + sensor.focal_error * float(focal)
    return replace(camera, camera_to_world=pose, focal_x=camera.focal_x * scale, focal_y=camera.focal_y * scale)


def _bands(rows: int, count: int) -> list[tuple[int, int]]:
    edges = np.linspace(0, rows, min(count, rows) + 1).round().astype(int).tolist()
    return list(pairwise(edges))


def _random(sensor: SensorSpec, purpose: int, view: int, frame: int) -> np.random.Generator:
    return np.random.default_rng([sensor.seed, purpose, view, frame])
