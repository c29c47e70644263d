"""What can be seen of a capture at the door, cheaply: names, headers, endings, and the numbers of its transforms.json.

Nothing is decoded here: of a picture the header is read (a hundred bytes) and the last bytes, which tell a file that
was cut off. What takes real work is for the runner, which may die of it.
"""

import json
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from nerfmodal.errors import InvalidCapture
from nerfmodal.limits import LARGEST_PICTURE
from PIL import Image, UnidentifiedImageError

PICTURES: Final = frozenset({".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp"})
FORMATS: Final = ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
OTHERS: Final = frozenset(
    {".json", ".txt", ".bin", ".npy", ".npz", ".csv", ".yaml", ".yml", ".md", ".toml"}
    | {".ply", ".pcd", ".xyz", ".las", ".laz", ".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v", ".wav"}
)
HIGHEST_FRAMES: Final = 100_000
HIGHEST_TRANSFORMS_BYTES: Final = 8 << 20
FEWEST_CAMERAS: Final = 3
HIGHEST_NUMBER: Final = 1e300
TAIL_BYTES: Final = 4096
ENDINGS: Final[Mapping[str, bytes]] = {"JPEG": b"\xff\xd9", "PNG": b"IEND"}
CAMERA_WORDS: Final = ("fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2")


@dataclass(frozen=True, slots=True)
class Picture:
    """What a picture's header says, in pixels."""

    width: int
    height: int


def inspect_folder(folder: Path, kind: str) -> dict[str, Any]:
    """Look at every file of a capture (or of a folder of clouds); returns what was counted.

    Raises
    ------
    InvalidCapture
        A file is of no kind that is read, broken, too large, or contradicts another; `where` names it.
    """
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    for name in names:
        _check_kind(folder, name)
    pictures = {name: look_at(folder / name, name) for name in names if _suffix(name) in PICTURES}
    facts: dict[str, Any] = {"files": len(names), "pictures": len(pictures)}
    if kind == "clouds":
        return facts | _inspect_clouds(folder, names)
    for name in names:
        if Path(name).name == "transforms.json":
            facts |= _inspect_transforms(folder, name, pictures)
    return facts


def look_at(path: Path, name: str) -> Picture:
    """The size of a picture that has a header and an end. Raises `InvalidCapture`."""
    try:
        with Image.open(path, formats=FORMATS) as image:
            (width, height), kind = image.size, image.format or ""
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise _refused(name, "has too many pixels", f"At most {LARGEST_PICTURE} are read.") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise _refused(name, "is no picture that can be read", "Use PNG, JPEG, WebP, TIFF or BMP.") from error
    if width * height > LARGEST_PICTURE:
        raise _refused(name, f"has {width} × {height} pixels", f"At most {LARGEST_PICTURE} are read.")
    if kind in ENDINGS and ENDINGS[kind] not in _tail(path):
        raise _refused(name, "ends in the middle", "It was cut off on its way: send it again.")
    return Picture(width, height)


def read_json(path: Path, name: str) -> Any:
    """A JSON document of moderate size without NaN, infinities or keys given twice. Raises `InvalidCapture`."""
    if path.stat().st_size > HIGHEST_TRANSFORMS_BYTES:
        raise _refused(name, "is too long", f"At most {HIGHEST_TRANSFORMS_BYTES} bytes are read.")
    try:
        return json.loads(path.read_bytes(), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise _refused(name, f"is no JSON ({error})", "Write it again; NaN and Infinity are no JSON.") from error


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number")


def _tail(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL_BYTES))
        return file.read()


def _suffix(name: str) -> str:
    return Path(name).suffix.lower()


def _check_kind(folder: Path, name: str) -> None:
    if _suffix(name) not in PICTURES | OTHERS:
        raise _refused(name, "is of no kind that is read", f"Kinds: {' '.join(sorted(PICTURES | OTHERS))}")
    if (folder / name).stat().st_size == 0:
        raise _refused(name, "is empty", "It was cut off on its way: send it again.")


def _inspect_clouds(folder: Path, names: Sequence[str]) -> dict[str, Any]:
    clouds = [name for name in names if _suffix(name) in (".ply", ".npz", ".pcd", ".xyz", ".las", ".laz")]
    if not clouds:
        raise InvalidCapture("there is no point cloud.", where="/files", hint="Send frame_0000.ply … or one .npz.")
    if "clouds.json" in names:
        document = read_json(folder / "clouds.json", "clouds.json")
        rate = document.get("frame_rate_hz") if isinstance(document, dict) else None
        if rate is not None:
            _number(rate, "clouds.json", "/frame_rate_hz", lowest=0.0)
    return {"clouds": len(clouds)}


def _inspect_transforms(folder: Path, name: str, pictures: Mapping[str, Picture]) -> dict[str, Any]:
    document = read_json(folder / name, name)
    frames = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise _refused(name, "has no list of frames at /frames", "See docs/howto/capture.md.")
    if len(frames) > HIGHEST_FRAMES:
        raise _refused(name, f"has {len(frames)} frames", f"At most {HIGHEST_FRAMES} are read.")
    _check_numbers(document, name, "")
    base = Path(name).parent
    for place, frame in enumerate(frames):
        _check_frame(frame, name, f"/frames/{place}")
        _check_picture(frame, name, f"/frames/{place}", document, base, pictures)
    return _check_views(frames, name)


def _check_frame(frame: Mapping[str, Any], name: str, at: str) -> None:
    _check_numbers(frame, name, at)
    matrix = frame.get("transform_matrix")
    if matrix is not None:
        rows = matrix if isinstance(matrix, list) and len(matrix) in (3, 4) else [None]
        for row in rows:
            if not isinstance(row, list) or len(row) != 4:
                raise _refused(name, f"has no 4 × 4 matrix at {at}/transform_matrix", "Give four rows of four.")
            for value in row:
                _number(value, name, f"{at}/transform_matrix")
    if frame.get("time_s") is not None:
        _number(frame["time_s"], name, f"{at}/time_s")
    index = frame.get("frame_index")
    if index is not None and (not isinstance(index, int) or not 0 <= index < HIGHEST_FRAMES):
        raise _refused(name, f"has no frame number at {at}/frame_index", f"Count from 0 to {HIGHEST_FRAMES - 1}.")


def _check_numbers(holder: Mapping[str, Any], name: str, at: str) -> None:
    for word in CAMERA_WORDS:
        if holder.get(word) is not None:
            positive = word in ("fl_x", "fl_y", "w", "h")
            _number(holder[word], name, f"{at}/{word}", lowest=0.0 if positive else None)


def _check_picture(
    frame: Mapping[str, Any],
    name: str,
    at: str,
    document: Mapping[str, Any],
    base: Path,
    pictures: Mapping[str, Picture],
) -> None:
    """The picture that a frame names is in the capture, and as large as the frame says."""
    path = frame.get("file_path")
    if path is None:
        return
    found = _find(str(path), base, pictures) if isinstance(path, str) else None
    if found is None:
        if isinstance(path, str) and re.search(r"\.(mp4|mov|mkv|avi|webm|m4v)$", path, re.IGNORECASE):
            return
        raise _refused(name, f"names a picture at {at}/file_path that was not sent: {path!r}", "Send it too.")
    picture = pictures[found]
    for word, size in (("w", picture.width), ("h", picture.height)):
        said = frame.get(word, document.get(word))
        if said is not None and int(said) != size:
            hint = "All pictures of a camera have the size that its w and h say."
            raise _refused(name, f"says {word} = {said} at {at}, but {found} has {size}", hint)


def _find(path: str, base: Path, pictures: Mapping[str, Picture]) -> str | None:
    """The name of a picture; nerfstudio and D-NeRF may leave './' before it and the suffix away."""
    plain = (base / path.removeprefix("./")).as_posix()
    return next((name for name in (plain, f"{plain}.png", f"{plain}.jpg") if name in pictures), None)


def _check_views(frames: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """Of each frame number enough cameras, each once."""
    seen: Counter[tuple[Any, ...]] = Counter()
    cameras: dict[Any, set[str]] = defaultdict(set)
    for view, index in _views(frames):
        seen[(view, index)] += 1
        cameras[index].add(view)
    twice = next((key for key, count in seen.items() if count > 1), None)
    if twice is not None:
        raise _refused(name, f"has frame {twice[1]} of camera {twice[0]!r} twice", "Give each view once.")
    fewest = min(len(group) for group in cameras.values())
    if fewest < FEWEST_CAMERAS:
        hint = f"A reconstruction needs at least {FEWEST_CAMERAS} cameras in each frame."
        raise _refused(name, f"has a frame of {fewest} cameras", hint)
    return {"cameras": max(len(group) for group in cameras.values()), "frames": len(cameras)}


def _views(frames: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Any]]:
    """The camera and the frame number of each entry; one that names no camera is a camera of its own."""
    for frame in frames:
        camera = frame.get("camera_id", frame.get("file_path"))
        yield str(camera), frame.get("frame_index", frame.get("time_s", frame.get("time", 0)))


def _number(value: Any, name: str, at: str, lowest: float | None = None) -> None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < HIGHEST_NUMBER
    if not good or (lowest is not None and value <= lowest):
        what = "positive number" if lowest is not None else "finite number"
        raise _refused(name, f"has no {what} at {at}", "Correct the value.")


def _refused(name: str, what: str, hint: str) -> InvalidCapture:
    return InvalidCapture(f"{name} {what}.", where="/files", hint=hint)
