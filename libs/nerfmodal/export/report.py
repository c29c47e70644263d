"""`report.html`: the whole scan in one file that needs no network, no script and no other file.

The template is `templates/report.html.j2`; pictures are embedded as data URIs, so that it can be mailed and archived.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from nerfmodal.export.manifest import media_type
from nerfmodal.export.modes import duration, modes_document
from nerfmodal.io import atomic_write
from nerfmodal.spec import HIGHEST_SHARE_OF_FRAME_RATE, ScanSpec
from nerfmodal.types import Frame, OrganResult, PointCloud, Reason, ScanResult

CAPTIONS = {
    "cameras": "What the cameras see in the first frame.",
    "cloud": "The reconstructed point cloud of the first frame; right: which organ each point was taken for.",
    "shapes": "Mode shapes at their largest swing, magnified; grey is the rest position (paper, Fig. 8).",
    "coordinates": "Modal coordinates and their spectra; the band is the 95 % interval of the frequency, the dashed "
    "envelope the identified decay (paper, Fig. 7).",
    "magnified": "Half a period of each mode alone, the others suppressed (paper, Fig. 9, eq 17-18 with β = 0).",
    "components": "Principal components of the displacement and their spectra (paper, Fig. 6).",
    "eigenvalues": "Eigenvalues of the displacement's covariance (paper, Fig. 5). Their number is no count of modes: "
    "every reconstruction error adds its own.",
}

REFERENCES = {"mean": "the mean position over the record", "first": "the first frame", "previous": "the frame before"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A picture as it stands in the report."""

    source: str
    caption: str


def render_report(
    spec: ScanSpec, result: ScanResult, frame: Frame | None, cloud: PointCloud | None, pictures: Sequence[Path]
) -> str:
    """The report as HTML. Pictures are `<what>.png` of the scan and `<organ>_<what>.png` of an organ."""
    by_stem = {path.stem: path for path in pictures}
    document = modes_document(result, spec)
    organs = [
        {"document": entry, "opinions": _opinions(organ), "pictures": _pictures(by_stem, f"{organ.organ}_")}
        for entry, organ in zip(document["organs"], result.organs, strict=True)
    ]
    return _template().render(
        document=document,
        organs=organs,
        facts=_facts(spec, result, frame, cloud),
        pictures=_pictures(by_stem, ""),
        reasons={reason.name: reason.value for reason in Reason},
    )


def write_report(
    spec: ScanSpec,
    result: ScanResult,
    frame: Frame | None,
    cloud: PointCloud | None,
    pictures: Sequence[Path],
    path: Path,
) -> Path:
    """Write the report to `path`."""
    with atomic_write(path) as temporary:
        temporary.write_text(render_report(spec, result, frame, cloud, pictures))
    return path


def measured(value: float | None, std: float | None, scale: float = 1.0) -> str:
    """Value ± standard deviation, both to the second digit of the latter; a dash for what is not known."""
    if value is None:
        return "–"
    if not std:
        return f"{scale * value:.4g}"
    decimals = int(np.clip(1 - np.floor(np.log10(scale * std)), 0, 9))
    return f"{scale * value:.{decimals}f} ± {scale * std:.{decimals}f}"


def share(value: float | None, digits: int = 3) -> str:
    """A number between 0 and 1, or a dash."""
    return "–" if value is None else f"{value:.{digits}f}"


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nerfmodal.export"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"share": share}
    environment.globals |= {"measured": measured}
    return environment.get_template("report.html.j2")


def _pictures(by_stem: Mapping[str, Path], prefix: str) -> list[Picture]:
    """The pictures called `<prefix><what>`, in the order of the captions."""
    named = ((by_stem.get(f"{prefix}{what}"), caption) for what, caption in CAPTIONS.items())
    return [Picture(source=_data_uri(path), caption=caption) for path, caption in named if path is not None]


def _data_uri(path: Path) -> str:
    return f"data:{media_type(path)};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _opinions(organ: OrganResult) -> list[dict[str, Any]]:
    """What each method saw by itself: its lines in Hz with the damping in per cent."""
    return [
        {
            "method": opinion.method.replace("_", " "),
            "lines": ", ".join(
                f"{frequency:.4g} Hz ({100 * damping:.2g} %)"
                for frequency, damping in zip(opinion.frequencies, opinion.damping_ratios, strict=True)
            ),
        }
        for opinion in organ.opinions
    ]


def _facts(spec: ScanSpec, result: ScanResult, frame: Frame | None, cloud: PointCloud | None) -> dict[str, str]:
    """What was measured and how, as pairs of words."""
    seconds = duration(result)
    lost = {organ.organ: int((~organ.displacement.valid).sum()) for organ in result.organs}
    facts = {
        "Source": _source(spec),
        "Record": f"{len(result.times)} frames at {result.frame_rate:g} frames/s, {seconds:.3g} s",
        "Excitation": result.excitation.replace("_", " "),
        "Method": spec.identification.method.replace("_", " "),
        "Displacement from": REFERENCES[spec.identification.reference],
    }
    if seconds > 0:
        highest = HIGHEST_SHARE_OF_FRAME_RATE * result.frame_rate
        facts["Can be told apart"] = (
            f"up to {highest:.4g} Hz; a Fourier bin of this record is {1 / seconds:.3g} Hz wide"
        )
    if frame is not None:
        count, height, width, _ = frame.images.shape
        facts["Views"] = f"{count} cameras, {width} × {height} px"
    if cloud is not None:
        facts["First cloud"] = f"{len(cloud.points):,} points. {cloud.outcome.value}"
    if any(lost.values()):
        facts["Frames lost"] = ", ".join(f"{name}: {count}" for name, count in lost.items() if count)
    return facts


def _source(spec: ScanSpec) -> str:
    source = spec.source
    if source.kind == "simulation":
        return f"simulated {source.structure}, {source.renderer} pictures"
    return f"{source.kind} {Path(source.path).name}"
