"""All pictures of a scan as files: of the scan, of every organ with its numbers, and a film of every mode."""

from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from nerfmodal.figures.cameras import camera_views, plant_views
from nerfmodal.figures.clouds import cloud as draw_cloud
from nerfmodal.figures.eigenvalues import eigenvalues
from nerfmodal.figures.films import write_film
from nerfmodal.figures.numbers import write_numbers
from nerfmodal.figures.shapes import magnified_frames, mode_shapes
from nerfmodal.figures.signals import modal_coordinates, principal_components
from nerfmodal.figures.stabilisation import diagram_of, stabilisation
from nerfmodal.figures.structure import structure_shapes
from nerfmodal.figures.style import save
from nerfmodal.io import atomic_write
from nerfmodal.types import Frame, OrganResult, PointCloud, ScanResult


def draw(result: ScanResult, frame: Frame | None, cloud: PointCloud | None, folder: Path) -> tuple[Path, ...]:
    """Draw every picture and film under `folder`, one at a time; returns the files written.

    `frame` and `cloud` are the first ones; without them their pictures are left out. The pictures of an organ are named
    `<organ>_<what>.png`, their numbers `<organ>.json`, the films `<organ>_mode_<k>.mp4` and `.gif`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [_write(folder / f"{name}.png", figure) for name, figure in _figures(result, frame, cloud)]
    films = [write_film(organ, k, folder) for organ in result.organs for k in range(len(organ.model.frequencies))]
    tables = [write_numbers(organ, folder / f"{organ.organ}.json") for organ in result.organs]
    return (*pictures, *tables, *(file for pair in films for file in pair))


def _figures(result: ScanResult, frame: Frame | None, cloud: PointCloud | None) -> Iterator[tuple[str, Figure]]:
    if frame is not None:
        yield "plant", plant_views(frame)
        yield "cameras", camera_views(frame)
    if cloud is not None:
        yield "cloud", draw_cloud(cloud, result)
    if result.structure:
        yield "structure", structure_shapes(result)
    for organ in result.organs:
        yield from _figures_of_organ(organ, result.excitation)


def _figures_of_organ(organ: OrganResult, excitation: str) -> Iterator[tuple[str, Figure]]:
    yield f"{organ.organ}_shapes", mode_shapes(organ)
    yield f"{organ.organ}_coordinates", modal_coordinates(organ, excitation)
    yield f"{organ.organ}_magnified", magnified_frames(organ)
    yield f"{organ.organ}_components", principal_components(organ)
    yield f"{organ.organ}_eigenvalues", eigenvalues(organ)
    if diagram_of(organ) is not None:
        yield f"{organ.organ}_stabilisation", stabilisation(organ)


def _write(path: Path, figure: Figure) -> Path:
    with atomic_write(path) as temporary:
        save(figure, temporary)
    return path
