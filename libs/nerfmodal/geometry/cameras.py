"""Camera models: world to pixel, pixel to ray direction, and the semi-spherical rig.

OpenGL cameras (+x right, +y up, looking along -z); image y runs down; pixel centres lie at half integers.
Distortion: Brown-Conrady as in OpenCV (k1 k2 p1 p2 k3 k4), and OpenCV's equidistant fisheye (k1..k4).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from nerfmodal.spec import RigSpec
from nerfmodal.types import Camera, Rig

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def project(
    camera: Camera, points: Float[np.ndarray, "points 3"]
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Pixels and depths (metres along the optical axis; negative behind the camera) of world points."""
    rotation, position = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3]
    local = (points - position) @ rotation
    depths = -local[:, 2]
    safe = np.where(np.abs(depths) < 1e-12, 1e-12, depths)
    normalised = np.stack([local[:, 0] / safe, -local[:, 1] / safe], axis=1)
    distorted = distort(camera, normalised)
    focal = np.array([camera.focal_x, camera.focal_y])
    return distorted * focal + np.array([camera.center_x, camera.center_y]), depths


def unproject(camera: Camera, pixels: Float[np.ndarray, "pixels 2"]) -> Float[np.ndarray, "pixels 3"]:
    """Unit directions in the world of the rays through `pixels`."""
    focal = np.array([camera.focal_x, camera.focal_y])
    normalised = undistort(camera, (pixels - np.array([camera.center_x, camera.center_y])) / focal)
    local = np.stack([normalised[:, 0], -normalised[:, 1], -np.ones(len(normalised))], axis=1)
    world = local @ camera.camera_to_world[:3, :3].T
    return np.asarray(world / np.linalg.norm(world, axis=1, keepdims=True))


def distort(camera: Camera, ideal: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
    """Where the lens puts the ideal normalised image points."""
    if camera.model == "pinhole":
        return ideal
    if camera.model == "fisheye":
        return _distort_fisheye(camera, ideal)
    k1, k2, k3, k4, p1, p2 = camera.distortion
    x, y = ideal[:, 0], ideal[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=1,
    )


def _distort_fisheye(camera: Camera, ideal: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
    k1, k2, k3, k4, _, _ = camera.distortion
    r = np.linalg.norm(ideal, axis=1, keepdims=True)
    theta = np.arctan(r)
    t2 = theta * theta
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    return np.asarray(ideal * np.where(r > 1e-9, bent / np.maximum(r, 1e-9), 1.0))


def undistort(
    camera: Camera, observed: Float[np.ndarray, "points 2"], iterations: int = 12
) -> Float[np.ndarray, "points 2"]:
    """Invert `distort` by Newton's method with a numerical Jacobian."""
    if camera.model == "pinhole":
        return observed
    ideal = observed.copy()
    step = 1e-6
    for _ in range(iterations):
        error = distort(camera, ideal) - observed
        along_x = (distort(camera, ideal + [step, 0.0]) - error - observed) / step
        along_y = (distort(camera, ideal + [0.0, step]) - error - observed) / step
        determinant = along_x[:, 0] * along_y[:, 1] - along_y[:, 0] * along_x[:, 1]
        ideal = ideal - np.stack(
            [
                (error[:, 0] * along_y[:, 1] - along_y[:, 0] * error[:, 1]) / determinant,
                (along_x[:, 0] * error[:, 1] - error[:, 0] * along_x[:, 1]) / determinant,
            ],
            axis=1,
        )
    return np.asarray(ideal)


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
    """The point nearest to all optical axes (least squares), and the mean distance to it, metres."""
    poses = np.stack([camera.camera_to_world for camera in rig.cameras])
    positions, axes = poses[:, :3, 3], poses[:, :3, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    center = np.linalg.solve(across.sum(axis=0), (across @ positions[:, :, None]).sum(axis=0))[:, 0]
    return center, float(np.linalg.norm(positions - center, axis=1).mean())
