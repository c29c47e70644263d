"""The paper's Figures 4 to 9 anew, named as the paper numbers them, and an animation of every mode."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from nerfmodal import figures
from nerfmodal.io import atomic_write
from nerfmodal.types import Frame, ScanResult

OF_ORGAN: Mapping[str, str] = {
    "eigenvalues": "figure_5_eigenvalues",
    "components": "figure_6_principal_components",
    "coordinates": "figure_7_modal_coordinates",
    "shapes": "figure_8_mode_shapes",
    "magnified": "figure_9_magnified_frames",
}
"""What `figures.draw` calls a picture of an organ, and what the paper does."""


def paper_figures(result: ScanResult, palm: Frame | None, drawn: Path, out: Path) -> tuple[Path, ...]:
    """Write figure_4 … figure_9 and mode_<k>.mp4 and .gif of every organ under `out`; returns the files.

    `palm` is a large picture of the plant at rest from several sides; without it there is no Figure 4. `drawn` is the
    folder of the scan's own pictures (`figures.draw`), of which the paper's are a choice.
    """
    out.mkdir(parents=True, exist_ok=True)
    written = [] if palm is None else [_palm(palm, out / "figure_4_palm.png")]
    for organ in result.organs:
        for name, papers in OF_ORGAN.items():
            written += _copied(drawn / f"{organ.organ}_{name}.png", out / f"{papers}_{organ.organ}.png")
        for k in range(len(organ.model.frequencies)):
            for suffix in ("mp4", "gif"):
                name = f"{organ.organ}_mode_{k}.{suffix}"
                written += _copied(drawn / name, out / f"animation_{name}")
    return tuple(written)


def _palm(frame: Frame, path: Path) -> Path:
    with atomic_write(path) as temporary:
        figures.save(figures.plant_views(frame), temporary)
    return path


def _copied(source: Path, target: Path) -> list[Path]:
    if not source.is_file():
        return []
    with atomic_write(target) as temporary:
        shutil.copyfile(source, temporary)
    return [target]
