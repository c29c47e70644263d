"""Everything a user downloads of a scan, written under one folder."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from nerfmodal.export.arrays import write_displacement
from nerfmodal.export.gltf import write_gltf
from nerfmodal.export.manifest import write_manifest
from nerfmodal.export.modes import modes_document, shape_key, write_json, write_modes
from nerfmodal.export.ply import write_vectors
from nerfmodal.export.report import write_report
from nerfmodal.export.tables import write_csv, write_parquet
from nerfmodal.export.uff import write_uff
from nerfmodal.export.vtp import write_vtp
from nerfmodal.io import write_result
from nerfmodal.spec import ScanSpec
from nerfmodal.types import Frame, PointCloud, ScanResult


def publish(
    spec: ScanSpec,
    result: ScanResult,
    frame: Frame | None,
    cloud: PointCloud | None,
    out: Path,
    *,
    pictures: Sequence[Path] = (),
) -> tuple[Path, ...]:
    """Write result.npz, spec.json, modes (.json .csv .parquet .uff), displacement.zarr.zip, shapes/, report.html and
    manifest.json under `out`.

    `pictures` are files under `out` that were drawn before (`figures.draw`); they go into the report and the manifest.
    Returns every file, pictures included.
    """
    write_result(out / "result.npz", result)
    specification = write_json(spec.model_dump(mode="json"), out / "spec.json")
    modes = write_modes(result, spec, out)
    report = write_report(spec, result, frame, cloud, pictures, out / "report.html")
    files = (out / "result.npz", specification, *modes, *_for_other_programs(result, spec, out), report, *pictures)
    return (*files, write_manifest(files, out))


def _for_other_programs(result: ScanResult, spec: ScanSpec, out: Path) -> Iterator[Path]:
    document = modes_document(result, spec)
    yield write_csv(document, out / "modes.csv")
    yield write_parquet(document, out / "modes.parquet")
    yield write_uff(result, spec.name, out / "modes.uff")
    yield write_displacement(result, out / "displacement.zarr.zip")
    for organ in result.organs:
        for k in range(len(organ.model.frequencies)):
            shape = out / shape_key(organ.organ, k)
            yield write_gltf(organ, k, shape.with_suffix(".glb"))
            yield write_vectors(organ, k, shape.with_suffix(".ply"))
            yield write_vtp(organ, k, shape.with_suffix(".vtp"))
