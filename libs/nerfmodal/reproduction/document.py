"""The stored result of a reproduction: what was run, every mode, every organ, and what was to be reached.

SI units with a unit suffix on every key; what is not known, or was not reported by the paper, is null.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from nerfmodal.identify.metrics import damping_error, frequency_error
from nerfmodal.reproduction.scores import OrganScore, ScoredMode
from nerfmodal.spec import ScanSpec, SimulationSource
from nerfmodal.types import ScanResult

Document = dict[str, Any]
PAPER_HZ: Mapping[str, float] = {"leaf bending_1": 2.0, "leaf bending_2": 5.0, "leaf torsion_1": 10.0}
"""What the paper found; of its branch, filmed at 1 Hz, it reports no number, nor any damping or MAC."""
PAPER_EIGENVALUES = 5
PAPERS_OWN = ("paper", "paper-coupled")
FREQUENCY_GOAL, DAMPING_GOAL, MAC_GOAL = 0.005, 0.5, 0.95


def experiment_document(
    spec: ScanSpec, result: ScanResult, modes: Sequence[ScoredMode], organs: Sequence[OrganScore], seconds: float
) -> Document:
    """One experiment: its specification in short, its modes and its organs. `seconds` is the wall time it took."""
    source = spec.source
    assert isinstance(source, SimulationSource)
    papers = spec.name in PAPERS_OWN
    return {
        "name": spec.name,
        "spec_digest": spec.digest(),
        "seed": spec.seed,
        "frames": source.frames,
        "frame_rate_hz": source.frame_rate_hz,
        "cameras": source.rig.cameras,
        "width_px": source.rig.width_px,
        "height_px": source.rig.height_px,
        "renderer": source.renderer,
        "samples": source.samples,
        "field": spec.reconstruction.field,
        "motion": "follow" if spec.reconstruction.follows else "refit",
        "iterations": spec.reconstruction.iterations,
        "fine_tune_iterations": spec.reconstruction.fine_tune_iterations,
        "device": result.provenance.device,
        "seconds": round(seconds, 1),
        "modes": [_mode(mode, papers=papers) for mode in modes],
        "organs": [_organ(organ, papers=papers) for organ in organs],
    }


def goals_of(experiment: Document) -> list[Document]:
    """What was to be reached, what was, and whether it was: from the stored rows alone."""
    return [
        {"what": what, "reached": float(reached), "goal": float(goal), "unit": unit, "met": bool(met)}
        for what, reached, goal, unit, met in _goals(experiment["modes"])
    ]


def _goals(rows: Sequence[Document]) -> Iterator[tuple[str, float, float, str, bool]]:
    imposed = [row for row in rows if row["truth_hz"] is not None]
    found = [row for row in imposed if row["verdict"] == "accepted"]
    false = sum(row["truth_hz"] is None and row["verdict"] == "accepted" for row in rows)
    complete = len(found) == len(imposed)
    yield "modes found and accepted", len(found), len(imposed), "modes", complete
    yield "accepted modes that are not in the truth", false, 0, "modes", false == 0
    if found:
        frequency = max(abs(frequency_error(row["found_hz"], row["truth_hz"])) for row in found)
        damping = max(abs(damping_error(row["found_damping"], row["truth_damping"])) for row in found)
        mac = min(row["mac"] for row in found)
        yield "largest error of a frequency", 100 * frequency, 100 * FREQUENCY_GOAL, "%", frequency <= FREQUENCY_GOAL
        yield "largest error of a damping ratio", damping, DAMPING_GOAL, "percentage points", damping <= DAMPING_GOAL
        yield "smallest MAC", mac, MAC_GOAL, "", mac >= MAC_GOAL


def _mode(mode: ScoredMode, *, papers: bool) -> Document:
    row = mode.row
    kind = f"{row.organ.split('_')[0]} {mode.shape}"
    return {
        "organ": row.organ,
        "shape": mode.shape,
        "paper_hz": PAPER_HZ.get(kind) if papers else None,
        "truth_hz": row.truth_hz,
        "found_hz": row.found_hz,
        "found_hz_std": row.found_hz_std,
        "truth_damping": row.truth_damping,
        "found_damping": row.found_damping,
        "found_damping_std": row.found_damping_std,
        "mac": row.mac,
        "verdict": None if row.verdict is None else row.verdict.value,
    }


def _organ(organ: OrganScore, *, papers: bool) -> Document:
    leaf = organ.organ.startswith("leaf")
    return {
        "organ": organ.organ,
        "sensors": organ.sensors,
        "paper_active_eigenvalues": PAPER_EIGENVALUES if papers and leaf else None,
        "truth_active_eigenvalues": organ.true_active,
        "active_eigenvalues": organ.active,
        "displacement_error": organ.displacement_error,
    }
