"""Camera models: world to pixel, pixel to ray direction, and the semi-spherical rig.

OpenGL cameras (+x right, +y up, looking along -z); image y runs down; pixel centres lie at half integers.
Pictures are never straightened: that would blur noise into neighbours. Rays bend instead (see `lenses`).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from nerfmodal.geometry.lenses import bend, distort, straighten, undistort
from nerfmodal.spec import RigSpec
from nerfmodal.types import Camera, Rig

__all__ = [
    "center_of",
    "distort",
    "downscale",
    "focal_of",
    "focus_of",
    "look_at",
    "project",
    "semi_spherical_rig",
    "undistort",
    "unproject",
]

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def project(
    camera: Camera, points: Float[np.ndarray, "points 3"]
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Pixels and depths (metres along the optical axis; negative behind the camera) of world points.

    A point that the lens cannot see (see `lenses`) falls far outside of the picture.
    """
    rotation, position = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3]
    local = (points - position) @ rotation
    depths = -local[:, 2]
    if camera.model == "fisheye":
        image = bend(camera, local)
    else:
        safe = np.where(np.abs(depths) < 1e-12, 1e-12, depths)
        image = distort(camera, np.stack([local[:, 0] / safe, -local[:, 1] / safe], axis=1))
    return image * focal_of(camera) + center_of(camera), depths


def unproject(camera: Camera, pixels: Float[np.ndarray, "pixels 2"]) -> Float[np.ndarray, "pixels 3"]:
    """Unit directions in the world of the rays through `pixels`."""
    local = straighten(camera, (pixels - center_of(camera)) / focal_of(camera))
    return np.asarray(local @ camera.camera_to_world[:3, :3].T)


def focal_of(camera: Camera) -> Float[np.ndarray, " 2"]:
    """Focal lengths along x and y, pixels."""
    return np.array([camera.focal_x, camera.focal_y])


def center_of(camera: Camera) -> Float[np.ndarray, " 2"]:
    """The pixel on the optical axis."""
    return np.array([camera.center_x, camera.center_y])


def downscale(camera: Camera, factor: int) -> Camera:
    """The camera that takes pictures `factor` times smaller (sizes rounded down)."""
    return replace(
        camera,
        width=camera.width // factor,
        height=camera.height // factor,
        focal_x=camera.focal_x / factor,
        focal_y=camera.focal_y / factor,
        center_x=camera.center_x / factor,
        center_y=camera.center_y / factor,
    )


def look_at(position: Float[np.ndarray, " 3"], target: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "4 4"]:
    """Camera-to-world matrix of a camera at `position` that looks at `target`, +z up."""
    backward = (position - target) / np.linalg.norm(position - target)
    up = np.array([0.0, 0.0, 1.0]) if abs(backward[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(backward, right), backward], axis=1)
    pose[:3, 3] = position
    return pose


def semi_spherical_rig(spec: RigSpec) -> Rig:
    """Cameras spread evenly (golden-angle spiral) over the band of the sphere between two elevations."""
    target = np.asarray(spec.target_m, dtype=float)
    low, high = np.sin(np.radians([spec.lowest_deg, spec.highest_deg]))
    heights = low + (np.arange(spec.cameras) + 0.5) / spec.cameras * (high - low)
    azimuths = GOLDEN_ANGLE * np.arange(spec.cameras)
    across = np.sqrt(1 - heights**2)
    offsets = np.stack([across * np.cos(azimuths), across * np.sin(azimuths), heights], axis=1)
    focal = 0.5 * max(spec.width_px, spec.height_px) / np.tan(np.radians(spec.field_of_view_deg) / 2)
    return Rig(
        cameras=tuple(
            Camera(
                name=f"cam{index:02d}",
                width=spec.width_px,
                height=spec.height_px,
                focal_x=float(focal),
                focal_y=float(focal),
                center_x=spec.width_px / 2,
                center_y=spec.height_px / 2,
                camera_to_world=look_at(target + spec.radius_m * offset, target),
            )
            for index, offset in enumerate(offsets)
        )
    )


def focus_of(rig: Rig) -> tuple[Float[np.ndarray, " 3"], float]:
    """The point nearest to all optical axes (least squares), and the mean distance to it, metres.

    Of parallel axes, which have no such point, some point is given that lies between the cameras.
    """
    poses = np.stack([camera.camera_to_world for camera in rig.cameras])
    positions, axes = poses[:, :3, 3], poses[:, :3, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    center = np.linalg.lstsq(across.sum(axis=0), (across @ positions[:, :, None]).sum(axis=0), rcond=1e-9)[0][:, 0]
    return center, float(np.linalg.norm(positions - center, axis=1).mean())
