"""The truth of a simulation as one .npz that only comparison code reads.

Its arrays are listed in docs/explanation/simulation.md.
Positions are streamed to the file frame by frame: a long record is never in memory.
"""

import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import InvalidInput
from nerfmodal.io.atomic import atomic_write
from nerfmodal.types import Camera, Mesh, Rig, TrueMode, TrueScene

FIRST_DATE = (1980, 1, 1, 0, 0, 0)
"""Of every entry: equal truths are equal files."""


def write_truth(
    path: Path,
    modes: Sequence[TrueMode],
    scene: TrueScene | None = None,
    positions: Iterable[Float[np.ndarray, "vertices 3"]] = (),
) -> None:
    """Write imposed modes and, of a simulation, its scene and the `positions` of its vertices, frame by frame."""
    arrays = _mode_arrays(modes) | ({} if scene is None else _scene_arrays(scene))
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(_entry(name), "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.ascontiguousarray(array), allow_pickle=False)  # type: ignore[no-untyped-call]
        if scene is not None:
            _write_positions(archive, positions, (len(scene.times), len(scene.mesh.vertices), 3))


def read_truth(path: Path) -> tuple[TrueMode, ...]:
    """Read imposed modes. Raises `InvalidInput` when the file is no truth."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return tuple(
                TrueMode(
                    organ=str(organ),
                    name=str(name),
                    frequency=float(archive["values"][index, 0]),
                    damping_ratio=float(archive["values"][index, 1]),
                    points=archive[f"points_{index}"],
                    shape=archive[f"shape_{index}"],
                    coordinates=archive[f"coordinates_{index}"],
                )
                for index, (organ, name) in enumerate(archive["names"])
            )
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise _no_truth(path, error) from error


def read_scene(path: Path) -> TrueScene:
    """Read what a simulation knew beside its modes. Raises `InvalidInput` when the file does not hold it."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return TrueScene(
                mesh=Mesh(
                    vertices=archive["rest"],
                    triangles=archive["triangles"],
                    colors=archive["colors"],
                    organ=archive["organ"],
                    organs=tuple(map(str, archive["organs"])),
                ),
                times=archive["times"],
                rig=_rig_of(archive["cameras"], archive["lenses"], archive["camera_to_world"]),
                modal_masses=archive["modal_masses"],
            )
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise _no_truth(path, error) from error


def read_positions(path: Path) -> Float[np.ndarray, "frames vertices 3"]:
    """Where the vertices of the scene's mesh were in every frame (world, metres, single precision).

    Raises `InvalidInput` when the file does not hold it.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return np.asarray(archive["positions"])
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise _no_truth(path, error) from error


def write_depths(path: Path, rig: Rig, depths: Float[np.ndarray, "cameras height width"]) -> None:
    """Write depths along the optical axes (metres, infinite where nothing is), with the cameras' names."""
    names = np.array([camera.name for camera in rig.cameras])
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, cameras=names, depths=depths.astype(np.float32))


def read_depths(path: Path) -> dict[str, Float[np.ndarray, "height width"]]:
    """Depths by the camera's name, metres. Raises `InvalidInput` when the file holds none."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {str(name): depth for name, depth in zip(archive["cameras"], archive["depths"], strict=True)}
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise _no_truth(path, error) from error


def _mode_arrays(modes: Sequence[TrueMode]) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {
        "names": np.array([[mode.organ, mode.name] for mode in modes], dtype=str).reshape(-1, 2),
        "values": np.array([[mode.frequency, mode.damping_ratio] for mode in modes]).reshape(-1, 2),
        "damped_frequencies": np.array([mode.damped_frequency for mode in modes]),
    }
    for index, mode in enumerate(modes):
        arrays[f"points_{index}"] = mode.points
        arrays[f"shape_{index}"] = mode.shape
        arrays[f"coordinates_{index}"] = mode.coordinates
    return arrays


def _scene_arrays(scene: TrueScene) -> dict[str, np.ndarray]:
    cameras = scene.rig.cameras
    return {
        "rest": scene.mesh.vertices,
        "triangles": scene.mesh.triangles,
        "colors": scene.mesh.colors,
        "organ": scene.mesh.organ,
        "organs": np.array(scene.mesh.organs, dtype=str),
        "times": scene.times,
        "modal_masses": scene.modal_masses,
        "cameras": np.array([camera.name for camera in cameras], dtype=str),
        "lenses": np.array([_lens(camera) for camera in cameras]),
        "camera_to_world": np.stack([camera.camera_to_world for camera in cameras]),
    }


def _lens(camera: Camera) -> tuple[float, ...]:
    return (float(camera.width), float(camera.height), camera.focal_x, camera.focal_y, camera.center_x, camera.center_y)


def _rig_of(names: np.ndarray, lenses: Float[np.ndarray, "cameras 6"], poses: Float[np.ndarray, "cameras 4 4"]) -> Rig:
    blank = Camera(
        name="", width=1, height=1, focal_x=1.0, focal_y=1.0, center_x=0.0, center_y=0.0, camera_to_world=np.eye(4)
    )
    return Rig(
        cameras=tuple(
            replace(
                blank,
                name=str(name),
                width=int(lens[0]),
                height=int(lens[1]),
                focal_x=float(lens[2]),
                focal_y=float(lens[3]),
                center_x=float(lens[4]),
                center_y=float(lens[5]),
                camera_to_world=pose,
            )
            for name, lens, pose in zip(names, lenses, poses, strict=True)
        )
    )


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(f"{name}.npy", date_time=FIRST_DATE)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _write_positions(archive: zipfile.ZipFile, positions: Iterable[np.ndarray], shape: tuple[int, int, int]) -> None:
    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
    with archive.open(_entry("positions"), "w", force_zip64=True) as file:
        np.lib.format.write_array_header_1_0(file, header)  # type: ignore[no-untyped-call]
        for frame in positions:
            file.write(np.ascontiguousarray(frame, dtype="<f4").tobytes())


def _no_truth(path: Path, error: Exception) -> InvalidInput:
    return InvalidInput(f"is no truth file ({error}).", where=str(path), hint="Simulate the scan again.")
