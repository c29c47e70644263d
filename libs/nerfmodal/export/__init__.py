"""What a user downloads: modes as JSON, table, arrays and for other programs; the report; the manifest."""

from nerfmodal.export.arrays import write_displacement
from nerfmodal.export.gltf import write_gltf
from nerfmodal.export.manifest import manifest, write_manifest
from nerfmodal.export.modes import modes_document, write_modes
from nerfmodal.export.ply import write_vectors
from nerfmodal.export.publish import publish
from nerfmodal.export.report import render_report, write_report
from nerfmodal.export.tables import write_csv, write_parquet
from nerfmodal.export.uff import write_uff
from nerfmodal.export.vtp import write_vtp

__all__ = [
    "manifest",
    "modes_document",
    "publish",
    "render_report",
    "write_csv",
    "write_displacement",
    "write_gltf",
    "write_manifest",
    "write_modes",
    "write_parquet",
    "write_report",
    "write_uff",
    "write_vectors",
    "write_vtp",
]
