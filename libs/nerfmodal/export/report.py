"""`report.html`: the whole scan in one file that needs no network, no script and no other file.

The template is `templates/report.html.j2`, its style `templates/report.css`; pictures and films are embedded as data
URIs, so that it can be mailed, archived and printed. What it says in words is in `words`.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from nerfmodal.export import words
from nerfmodal.export.manifest import media_type
from nerfmodal.export.modes import modes_document
from nerfmodal.export.numbers import interval, measured, share
from nerfmodal.io import atomic_write
from nerfmodal.spec import ScanSpec
from nerfmodal.types import Frame, OrganResult, PointCloud, Reason, ScanResult

CAPTIONS = {
    "plant": "What was filmed, from two sides (paper, Fig. 4).",
    "cameras": "What the cameras see in the first frame.",
    "cloud": "The reconstructed point cloud of the first frame; right: which organ each point was taken for.",
    "shapes": "Mode shapes at their largest swing, magnified; the grey line is the rest position (paper, Fig. 8).",
    "coordinates": "Modal coordinates and their spectra; the band is the 95 % interval of the frequency, the dashed "
    "envelope the identified decay (paper, Fig. 7).",
    "magnified": "Half a period of each mode alone, the others suppressed (paper, Fig. 9, eq 17-18 with β = 0).",
    "stabilisation": "Stabilisation diagram: poles of models of rising order over the spectrum of the displacement. "
    "A mode is a column of dots.",
    "components": "Principal components of the displacement and their spectra (paper, Fig. 6).",
    "eigenvalues": "Eigenvalues of the displacement's covariance (paper, Fig. 5). Their number is no count of modes: "
    "every reconstruction error adds its own.",
}

SHARED = "Motions that several organs share, at their largest swing, magnified; the grey lines are the rest position."


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A picture or film as it stands in the report."""

    source: str
    caption: str


def render_report(
    spec: ScanSpec, result: ScanResult, frame: Frame | None, cloud: PointCloud | None, pictures: Sequence[Path]
) -> str:
    """The report as HTML.

    Pictures are `<what>.png` of the scan and `<organ>_<what>.png` of an organ, films `<organ>_mode_<k>.mp4`.
    """
    named = {path.name: path for path in pictures}
    document = modes_document(result, spec)
    organs = [
        {
            "document": entry,
            "opinions": _opinions(organ),
            "pictures": _pictures(named, f"{organ.organ}_"),
            "films": _films(named, organ),
        }
        for entry, organ in zip(document["organs"], result.organs, strict=True)
    ]
    return _template().render(
        document=document,
        organs=organs,
        summary=words.summary(document),
        facts=words.facts(spec, result, frame, cloud),
        pictures=_pictures(named, ""),
        shared=_shared(named),
        reasons={reason.name: reason.value for reason in Reason},
        verdicts=words.VERDICTS,
        surfaces=words.SURFACES,
        citation=words.citation(spec.name, result.provenance),
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


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nerfmodal.export"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"share": share}
    environment.globals |= {"measured": measured, "interval": interval}
    return environment.get_template("report.html.j2")


def _pictures(named: Mapping[str, Path], prefix: str) -> list[Picture]:
    """The pictures called `<prefix><what>.png`, in the order of the captions."""
    found = ((named.get(f"{prefix}{what}.png"), caption) for what, caption in CAPTIONS.items())
    return [Picture(source=_data_uri(path), caption=caption) for path, caption in found if path is not None]


def _shared(named: Mapping[str, Path]) -> list[Picture]:
    path = named.get("structure.png")
    return [] if path is None else [Picture(source=_data_uri(path), caption=SHARED)]


def _films(named: Mapping[str, Path], organ: OrganResult) -> list[Picture]:
    films = []
    for k, frequency in enumerate(organ.model.frequencies):
        path = named.get(f"{organ.organ}_mode_{k}.mp4")
        if path is not None:
            films.append(Picture(source=_data_uri(path), caption=f"Mode {k}, {frequency:.4g} Hz"))
    return films


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
