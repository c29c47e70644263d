"""COLMAP in a process of its own: `python -m nerfmodal.capture.structure FOLDER [--one-lens]`.

A wheel that catches the process's signals and can end it on a failed check has no place in a worker. Reads
FOLDER/images, writes the largest model as text into FOLDER and its figures into FOLDER/solution.json (none where no two
pictures fit), and prints a line for each stage.
"""

import json
import sys
from pathlib import Path
from typing import Any

LARGEST_SIDE = 2000
FEWEST_MATCHES = 15
SEED = 0


def main() -> None:
    """Solve FOLDER."""
    below, one_lens = Path(sys.argv[1]), "--one-lens" in sys.argv[2:]
    model = largest_model(below, one_lens=one_lens)
    if model is None:
        return
    model.write_text(str(below))
    figures = {"error_px": float(model.compute_mean_reprojection_error()), "points": int(model.num_points3D())}
    (below / "solution.json").write_text(json.dumps(figures))


def largest_model(below: Path, *, one_lens: bool) -> Any:
    """The reconstruction with most pictures; None where there is none."""
    import pycolmap as colmap

    colmap.logging.minloglevel = int(colmap.logging.ERROR.value)
    colmap.set_random_seed(SEED)
    database = below / "database.db"
    _find_features(colmap, below, one_lens=one_lens)
    print("matching every pair", flush=True)
    matching = colmap.FeatureMatchingOptions()
    matching.use_gpu = False
    colmap.match_exhaustive(database, matching_options=matching, device=colmap.Device.cpu)
    print("solving the cameras", flush=True)
    (below / "models").mkdir()
    options = colmap.IncrementalPipelineOptions()
    options.min_num_matches = FEWEST_MATCHES
    options.random_seed = SEED
    models = colmap.incremental_mapping(database, below / "images", below / "models", options)
    return max(models.values(), key=lambda one: one.num_reg_images(), default=None)


def _find_features(colmap: Any, below: Path, *, one_lens: bool) -> None:
    print("finding features", flush=True)
    reader = colmap.ImageReaderOptions()
    reader.camera_model = "OPENCV" if one_lens else "SIMPLE_RADIAL"
    extraction = colmap.FeatureExtractionOptions()
    extraction.max_image_size = LARGEST_SIDE
    extraction.use_gpu = False
    colmap.extract_features(
        below / "database.db",
        below / "images",
        camera_mode=colmap.CameraMode.SINGLE if one_lens else colmap.CameraMode.PER_IMAGE,
        reader_options=reader,
        extraction_options=extraction,
        device=colmap.Device.cpu,
    )


if __name__ == "__main__":
    main()
