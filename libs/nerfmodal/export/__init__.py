"""What a user downloads: modes as JSON, table and arrays, the report, the manifest."""

from nerfmodal.export.manifest import manifest, write_manifest
from nerfmodal.export.modes import modes_document, write_modes
from nerfmodal.export.publish import publish
from nerfmodal.export.report import render_report, write_report

__all__ = [
    "manifest",
    "modes_document",
    "publish",
    "render_report",
    "write_manifest",
    "write_modes",
    "write_report",
]
