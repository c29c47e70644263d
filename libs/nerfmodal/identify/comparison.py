"""Two sets of modes side by side: a result and the truth, or two results.

The truth's shape is taken where the result's sensors stand and along the directions in which they measure. A leaf's
sensors take it from the nearest truth points, a trunk's from those nearest along its axis: the points of a
cross-section move alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import interpolate, spatial

from nerfmodal.identify.metrics import mac_matrix, pair
from nerfmodal.types import ModalModel, OrganResult, ScanResult, TrueMode, Verdict

PAIR_SHARE = 0.15
"""Two modes are paired if they differ by at most this share in frequency, or by `PAIR_HZ`."""
PAIR_HZ = 0.3
NEIGHBOURS = 6
PLATE_POINTS = 24
PLATE_SMOOTHING = 1e-9
"""Keeps the plate defined where neighbours lie on one line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRow:
    """One mode beside its truth (or beside the other result's); None on the side that lacks it.

    Frequencies in Hz, damping ratios in 0-1; `mode` numbers the rows of an organ from 1.
    """

    organ: str
    mode: int
    truth_hz: float | None
    found_hz: float | None
    truth_damping: float | None
    found_damping: float | None
    mac: float | None
    verdict: Verdict | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Side:
    """Frequencies, damping ratios and shapes (dofs, modes) of one organ's modes on one side."""

    frequencies: Float[np.ndarray, " modes"]
    ratios: Float[np.ndarray, " modes"]
    shapes: Float[np.ndarray, "dofs modes"]


def compare(result: ScanResult, truth: Sequence[TrueMode]) -> list[ComparisonRow]:
    """Every mode found beside the imposed one it is paired with by frequency and MAC; both sides' rest is kept.

    Found modes that the product itself rejected or doubts are only paired where no accepted one fits.
    """
    organs = {organ.organ: organ for organ in result.organs}
    names = list(dict.fromkeys([organ.organ for organ in result.organs] + [mode.organ for mode in truth]))
    rows: list[ComparisonRow] = []
    for name in names:
        imposed = [mode for mode in truth if mode.organ == name]
        if name in organs:
            rows += _rows(name, _true_side(organs[name], imposed), organs[name].model)
        else:
            rows += _missing(name, imposed)
    return rows


def compare_results(first: ScanResult, second: ScanResult) -> list[ComparisonRow]:
    """Every mode of `second` (found) beside that of `first` (in the truth's columns); organs are paired by name."""
    return compare(second, [mode for organ in first.organs for mode in modes_as_truth(organ)])


def modes_as_truth(organ: OrganResult) -> list[TrueMode]:
    """A result's modes in the form of imposed ones, so that another result can be held against them."""
    vectors = np.einsum("sam,ac->mcs", organ.model.mode_shapes, organ.displacement.directions)
    return [
        TrueMode(
            organ=organ.organ,
            name=f"mode_{index + 1}",
            frequency=float(organ.model.frequencies[index]),
            damping_ratio=float(organ.model.damping_ratios[index]),
            points=organ.displacement.sensors.positions,
            shape=vectors[index].T,
            coordinates=organ.model.coordinates[:, index],
        )
        for index in range(len(organ.model.frequencies))
    ]


def truth_at_sensors(organ: OrganResult, mode: TrueMode) -> Float[np.ndarray, " dofs"]:
    """The imposed shape where the organ's sensors stand, along their directions (not normalised)."""
    positions = organ.displacement.sensors.positions
    if organ.surface == "cylinder":
        axis = _axis_of(organ)
        vectors = _nearest(mode.points @ axis[:, None], mode.shape, positions @ axis[:, None])
    else:
        vectors = _interpolated(mode.points, mode.shape, positions)
    return np.asarray(vectors @ organ.displacement.directions.T).ravel()


def _true_side(organ: OrganResult, imposed: Sequence[TrueMode]) -> _Side:
    dofs = organ.model.mode_shapes.shape[0] * organ.model.mode_shapes.shape[1]
    shapes = [truth_at_sensors(organ, mode) for mode in imposed]
    return _Side(
        frequencies=np.array([mode.frequency for mode in imposed]),
        ratios=np.array([mode.damping_ratio for mode in imposed]),
        shapes=np.stack(shapes, axis=1) if shapes else np.zeros((dofs, 0)),
    )


def _rows(name: str, true: _Side, model: ModalModel) -> list[ComparisonRow]:
    found = model.mode_shapes.reshape(len(true.shapes), len(model.frequencies))
    likeness = mac_matrix(true.shapes, found)
    pairs = _pair_accepted_first(true, model, likeness)
    partner = dict(pairs)
    taken = set(partner.values())
    places: list[tuple[int | None, int | None]] = [
        (index, partner.get(index)) for index in range(len(true.frequencies))
    ]
    places += [(None, index) for index in range(len(model.frequencies)) if index not in taken]
    places.sort(key=lambda place: _frequency_of(place, true, model))
    return [_row(name, number, place, true, model, likeness) for number, place in enumerate(places, start=1)]


def _pair_accepted_first(true: _Side, model: ModalModel, likeness: np.ndarray) -> list[tuple[int, int]]:
    within = max(
        PAIR_HZ, PAIR_SHARE * float(max(true.frequencies.max(initial=0.0), model.frequencies.max(initial=0.0)))
    )
    allowed = np.abs(np.subtract.outer(true.frequencies, model.frequencies))
    allowed = allowed <= np.maximum(PAIR_HZ, PAIR_SHARE * true.frequencies)[:, None]
    accepted = np.array([quality.verdict is Verdict.ACCEPTED for quality in model.quality], dtype=bool)
    pairs: list[tuple[int, int]] = []
    for group in (accepted, ~accepted):
        rows = np.setdiff1d(np.arange(len(true.frequencies)), [row for row, _ in pairs])
        columns = np.flatnonzero(group)
        near = allowed[np.ix_(rows, columns)]
        alike = np.where(near, likeness[np.ix_(rows, columns)] + 1e-6, 0.0)
        proposed = pair(true.frequencies[rows], model.frequencies[columns], alike, within_hz=within)
        pairs += [(int(rows[row]), int(columns[column])) for row, column in proposed if near[row, column]]
    return pairs


def _frequency_of(place: tuple[int | None, int | None], true: _Side, model: ModalModel) -> float:
    index, found = place
    return float(true.frequencies[index] if index is not None else model.frequencies[found or 0])


def _row(
    name: str,
    number: int,
    place: tuple[int | None, int | None],
    true: _Side,
    model: ModalModel,
    likeness: np.ndarray,
) -> ComparisonRow:
    index, found = place
    return ComparisonRow(
        organ=name,
        mode=number,
        truth_hz=None if index is None else float(true.frequencies[index]),
        found_hz=None if found is None else float(model.frequencies[found]),
        truth_damping=None if index is None else float(true.ratios[index]),
        found_damping=None if found is None else float(model.damping_ratios[found]),
        mac=None if index is None or found is None else float(likeness[index, found]),
        verdict=None if found is None else model.quality[found].verdict,
    )


def _missing(name: str, imposed: Sequence[TrueMode]) -> list[ComparisonRow]:
    """Imposed modes of an organ that the result does not have at all."""
    return [
        ComparisonRow(
            organ=name,
            mode=number,
            truth_hz=mode.frequency,
            found_hz=None,
            truth_damping=mode.damping_ratio,
            found_damping=None,
            mac=None,
            verdict=None,
        )
        for number, mode in enumerate(sorted(imposed, key=lambda mode: mode.frequency), start=1)
    ]


def _axis_of(organ: OrganResult) -> np.ndarray:
    """The direction along a rod: across both directions that it is measured in."""
    first, second = organ.displacement.directions
    return np.cross(first, second)


def _nearest(points: np.ndarray, values: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Mean of the few nearest points' values, weighted by inverse distance."""
    count = min(NEIGHBOURS, len(points))
    found = spatial.cKDTree(points).query(targets, k=count)
    distances, places = (np.asarray(part).reshape(len(targets), count) for part in found)
    weights = 1.0 / (distances + 1e-9)
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("tk,tkc->tc", weights, values[places]))


def _interpolated(points: np.ndarray, values: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """A thin plate through the nearby points of the organ's plane, which reaches a little over their edge."""
    center = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - center, full_matrices=False)
    if len(points) < PLATE_POINTS or extents[1] < 1e-3 * extents[0]:
        return _nearest(points, values, targets)
    flat, places = np.unique(np.round((points - center) @ axes[:2].T, 6), axis=0, return_index=True)
    plate = interpolate.RBFInterpolator(flat, values[places], neighbors=PLATE_POINTS, smoothing=PLATE_SMOOTHING)
    return np.asarray(plate((targets - center) @ axes[:2].T))
