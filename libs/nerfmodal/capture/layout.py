"""What a folder says of itself, before anything is found out: cameras with poses or without, and what each filmed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from nerfmodal.capture.colmap import model_folder, read_model
from nerfmodal.capture.footage import find_footage
from nerfmodal.capture.rigfile import FILE, read_rig
from nerfmodal.capture.transforms import inside
from nerfmodal.errors import InvalidCapture
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Camera

LEAST_REGISTERED = 0.5
"""A model with poses for this share of the pictures or less is refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """`cameras` are None where they have to be solved; `filmed` is the file or folder of each camera by its name.

    `offsets` (s) are those that the folder itself tells; `trusted` says that the time stamps of its videos agree.
    """

    where: str
    cameras: tuple[Camera, ...] | None
    filmed: Mapping[str, Path]
    frame_rate: float | None = None
    offsets: Mapping[str, float] = field(default_factory=dict)
    trusted: bool = False
    absent: tuple[str, ...] = ()


def videos_layout(source: CaptureSource) -> Layout:
    """A folder with a rig.json and a video or a folder of pictures for each of its cameras.

    Raises
    ------
    InvalidCapture
        When a camera of the rig has filmed nothing.
    """
    folder = Path(source.path)
    where = folder / FILE
    rig = read_rig(where)
    found = find_footage(folder)
    filmed = {}
    for number, camera in enumerate(rig.cameras):
        place = f"{where}#/cameras/{number}"
        name = rig.files.get(camera.name)
        path = found.get(camera.name) if name is None else inside(folder, name, place)
        if path is None or not path.exists():
            raise InvalidCapture(
                f"the camera {camera.name!r} has no video and no pictures.",
                where=place,
                hint=f"Put {name or camera.name + '.mp4'} into the folder, or take the camera out of the rig.",
            )
        filmed[camera.name] = path
    return Layout(
        where=str(where),
        cameras=rig.cameras,
        filmed=filmed,
        frame_rate=rig.frame_rate,
        offsets=rig.offsets,
        absent=tuple(sorted(set(found) - set(filmed))),
    )


def unsolved_layout(source: CaptureSource) -> Layout:
    """Videos or pictures without poses. Raises `InvalidCapture` when there are none."""
    folder = Path(source.path)
    filmed = find_footage(folder)
    if not filmed:
        raise InvalidCapture(
            "is no capture: it has no transforms.json, rig.json, poses_bounds.npy or COLMAP model, no videos and no "
            "pictures.",
            where=str(folder),
            hint="See docs/howto/capture.md for what is read.",
        )
    return Layout(where=str(folder), cameras=None, filmed=filmed)


def colmap_layout(source: CaptureSource) -> Layout:
    """Pictures or videos beside a COLMAP model.

    An image of the model is one camera. Images in several folders are cameras by folder, whose other pictures are
    further frames; a video called as an image is that camera's film.

    Raises
    ------
    InvalidCapture
        When the model has no pose for half of the cameras, or a camera moves.
    """
    folder = Path(source.path)
    model = model_folder(folder)
    if model is None:
        raise InvalidCapture(
            "has no COLMAP model.", where=str(folder), hint="Put cameras.bin and images.bin into sparse/0."
        )
    registered = read_model(model)
    found = find_footage(folder)
    by_folder = any(path.is_dir() for path in found.values())
    cameras: dict[str, Camera] = {}
    for one in registered:
        name = Path(one.name).parent.name if by_folder and "/" in one.name else Path(one.name).stem
        cameras.setdefault(name, replace(one, name=name))
    known = {name: camera for name, camera in cameras.items() if name in found}
    unposed = tuple(sorted(set(found) - set(cameras)))
    if len(known) <= LEAST_REGISTERED * len(found) or not found:
        raise InvalidCapture(
            f"has poses for {len(known)} of {len(found)} cameras; without: {', '.join(unposed[:5]) or 'none'}.",
            where=str(model),
            hint="Solve again with more overlap between neighbours, or take the pictures without a pose out.",
        )
    return Layout(
        where=str(model),
        cameras=tuple(known.values()),
        filmed={name: found[name] for name in known},
        absent=(*unposed, *sorted(set(cameras) - set(found))),
    )
