"""What the report says in words: what was measured, how, what set it in motion, how to read and cite the numbers."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nerfmodal.export.modes import duration
from nerfmodal.spec import HIGHEST_SHARE_OF_FRAME_RATE, ScanSpec
from nerfmodal.types import Frame, PointCloud, Provenance, ScanResult

REFERENCES = {"mean": "the mean position over the record", "first": "the first frame", "previous": "the frame before"}
METHODS = {
    "damped_sinusoids": "a whitened joint fit of damped sinusoids to all channels at once, one more line as long as it "
    "beats what chance would give",
    "complexity_pursuit": "the paper's chain: principal components, complexity pursuit, spectral peak, logarithmic "
    "decrement",
}
SURFACES = {
    "polynomial": "polynomial surface",
    "tensor": "tensor-product surface",
    "spline": "spline surface",
    "cylinder": "cylinder with a curved axis",
}
EXCITATIONS = {
    "free_decay": "free decay (pulled and let go)",
    "ambient": "ambient (wind or another random force)",
    "harmonic": "steady harmonic motion",
}
RECOGNISED = {
    "free_decay": "recognised: damped sinusoids explain nearly all of the modal coordinates' energy, and they fall "
    "visibly over the record",
    "ambient": "recognised: damped sinusoids leave a good part of the modal coordinates' energy, and what they leave "
    "vibrates too",
    "harmonic": "recognised: sinusoids that hardly decay over the record explain nearly all of the modal coordinates' "
    "energy",
}
VERDICTS = {
    "accepted": "the record supports the mode and no check speaks against it",
    "doubtful": "the mode may be real, but a check named below it speaks against its numbers",
    "rejected": "the line is explained by something else, named below it; it is listed so that nothing is hidden",
}
PAPER = (
    "T. F. Ribeiro, V. H. R. Cardoso, J. C. W. A. Costa and M. F. Silva: "
    "Full-Field 3D Structural Dynamics via Neural Radiance Fields."
)


def summary(document: Mapping[str, Any]) -> str:
    """How many modes of which verdict, in one sentence."""
    verdicts = Counter(mode["verdict"] for organ in document["organs"] for mode in organ["modes"])
    if not verdicts:
        return "No modes were identified."
    counted = [f"{verdicts[name]} {name}" for name in VERDICTS if verdicts[name]]
    modes, organs = sum(verdicts.values()), len(document["organs"])
    of = f"{modes} {'mode' if modes == 1 else 'modes'} of {organs} {'organ' if organs == 1 else 'organs'}"
    return f"{of}: {', '.join(counted)}."


def excitation(spec: ScanSpec, result: ScanResult) -> str:
    """What set the structure in motion, and how that is known."""
    kind = EXCITATIONS.get(result.excitation, result.excitation.replace("_", " "))
    given = spec.identification.excitation != "auto"
    return f"{kind}; {'given in the specification' if given else RECOGNISED.get(result.excitation, 'recognised')}"


def facts(spec: ScanSpec, result: ScanResult, frame: Frame | None, cloud: PointCloud | None) -> dict[str, str]:
    """What was measured and how, as pairs of words."""
    seconds = duration(result)
    told = _subject(spec) | {
        "Source": _source(spec),
        "Record": f"{len(result.times)} frames at {result.frame_rate:g} frames/s, {seconds:.3g} s",
    }
    if frame is not None:
        count, height, width, _ = frame.images.shape
        told["Views"] = f"{count} cameras, {width} × {height} px"
    if cloud is not None:
        told["First cloud"] = f"{len(cloud.points):,} points. {cloud.outcome.value}"
    if result.provenance.rig_certificate is not None:
        told["Rig certificate"] = result.provenance.rig_certificate[:16]
    told["Excitation"] = excitation(spec, result)
    told["Displacement"] = (
        f"of virtual sensors on each organ's surface, from {REFERENCES[spec.identification.reference]}"
    )
    told["Method"] = METHODS[spec.identification.method]
    if seconds > 0:
        highest = HIGHEST_SHARE_OF_FRAME_RATE * result.frame_rate
        told["Can be told apart"] = f"up to {highest:.4g} Hz; a Fourier bin of this record is {1 / seconds:.3g} Hz wide"
    lost = {organ.organ: int((~organ.displacement.valid).sum()) for organ in result.organs}
    if any(lost.values()):
        told["Frames lost"] = ", ".join(f"{name}: {count}" for name, count in lost.items() if count)
    return told


def citation(name: str, provenance: Provenance) -> tuple[str, ...]:
    """What to cite: the method's paper, and this result so that it can be computed again."""
    day = provenance.finished[:10]
    ours = (
        f"nerfmodal {provenance.package_version}, scan “{name}”, specification SHA-256 "
        f"{provenance.spec_digest[:16]}, seed {provenance.seed}, {day}."
    )
    return PAPER, ours


def _subject(spec: ScanSpec) -> dict[str, str]:
    """Which plant of the fleet, where the specification says so."""
    told: dict[str, str] = {}
    if spec.plant is not None:
        parts = (spec.plant.id, spec.plant.position, spec.plant.treatment)
        told["Plant"] = ", ".join(part for part in parts if part)
    if spec.tags:
        told["Tags"] = ", ".join(spec.tags)
    return told


def _source(spec: ScanSpec) -> str:
    source = spec.source
    if source.kind == "simulation":
        return f"simulated {source.structure}, {source.renderer} pictures"
    return f"{source.kind} {Path(source.path).name}"
