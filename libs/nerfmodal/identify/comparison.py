"""Two sets of modes side by side: a result and the truth, or two results.

The truth's shape is taken where the result's sensors are at rest and along the directions in which they measure. A
leaf's sensors take it from the nearest truth points, a trunk's from those nearest along its axis: the points of a
cross-section move alike. Organs are paired by name; those left over on both sides, by where they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy import interpolate, spatial

from nerfmodal.identify.metrics import damping_error, frequency_error, mac_matrix, pair
from nerfmodal.types import DisplacementMatrix, ModalModel, OrganResult, ScanResult, TrueMode, Verdict

PAIR_SHARE = 0.15
"""Two modes are paired if they differ by at most this share in frequency, or by `PAIR_HZ`."""
PAIR_HZ = 0.3
SAME_PLACE = 0.25
"""Organs of different names are one if their middles are within this share of the organ's length."""
MOST_SENSORS = 2000
"""At which shapes are compared: an even choice of more has the same MAC."""
NEIGHBOURS = 6
PLATE_POINTS = 24
PLATE_SMOOTHING = 1e-9
"""Keeps the plate defined where neighbours lie on one line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRow:
    """One mode beside its truth (or beside the other result's); None on the side that lacks it.

    Frequencies in Hz, damping ratios in 0-1; `mode` numbers the rows of an organ from 1. A truth's deviations are 0,
    an unknown one is None. `frequency_error` is relative, `damping_error` in percentage points, found minus true.
    """

    organ: str
    mode: int
    truth_hz: float | None
    found_hz: float | None
    truth_damping: float | None
    found_damping: float | None
    mac: float | None
    verdict: Verdict | None
    truth_hz_std: float | None = None
    found_hz_std: float | None = None
    truth_damping_std: float | None = None
    found_damping_std: float | None = None

    @property
    def frequency_error(self) -> float | None:
        """(found - true) / true."""
        if self.truth_hz is None or self.found_hz is None:
            return None
        return frequency_error(self.found_hz, self.truth_hz)

    @property
    def damping_error(self) -> float | None:
        """Found minus true in percentage points."""
        if self.truth_damping is None or self.found_damping is None:
            return None
        return damping_error(self.found_damping, self.truth_damping)

    @property
    def frequency_deviations(self) -> float | None:
        """Distance of the frequencies in standard deviations of their difference."""
        return _deviations(self.truth_hz, self.found_hz, self.truth_hz_std, self.found_hz_std)

    @property
    def damping_deviations(self) -> float | None:
        """Distance of the damping ratios in standard deviations of their difference."""
        return _deviations(self.truth_damping, self.found_damping, self.truth_damping_std, self.found_damping_std)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Imposed:
    """A mode to hold others against, with the deviations of its own frequency (Hz) and damping ratio."""

    mode: TrueMode
    frequency_std: float | None = 0.0
    damping_std: float | None = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Side:
    """The modes to hold an organ's against, and their shapes (dofs, modes) at its sensors."""

    imposed: tuple[_Imposed, ...]
    shapes: Float[np.ndarray, "dofs modes"]

    @property
    def frequencies(self) -> Float[np.ndarray, " modes"]:
        return np.array([each.mode.frequency for each in self.imposed])


def compare(result: ScanResult, truth: Sequence[TrueMode]) -> list[ComparisonRow]:
    """Every mode found beside the imposed one it is paired with by frequency and MAC; both sides' rest is kept.

    Found modes that the product itself rejected or doubts are only paired where no accepted one fits.
    """
    return _compare(result, [_Imposed(mode=mode) for mode in truth])


def compare_results(first: ScanResult, second: ScanResult) -> list[ComparisonRow]:
    """Every mode of `second` (found) beside that of `first` (in the truth's columns)."""
    return _compare(second, [each for organ in first.organs for each in _as_imposed(organ)])


def _compare(result: ScanResult, imposed: Sequence[_Imposed]) -> list[ComparisonRow]:
    thinned = [_thinned(organ) for organ in result.organs]
    names = list(dict.fromkeys(each.mode.organ for each in imposed))
    partner = _organ_pairs(thinned, names, imposed)
    rows: list[ComparisonRow] = []
    for organ in thinned:
        mine = [each for each in imposed if each.mode.organ == partner.get(organ.organ)]
        rows += _rows(organ.organ, _true_side(organ, mine), organ.model)
    for name in names:
        if name not in partner.values():
            rows += _missing(name, [each for each in imposed if each.mode.organ == name])
    return rows


def _organ_pairs(organs: Sequence[OrganResult], names: Sequence[str], imposed: Sequence[_Imposed]) -> dict[str, str]:
    """The imposed organ that each found one is held against: of its name, else the nearest in its place."""
    partner = {organ.organ: organ.organ for organ in organs if organ.organ in names}
    left = [name for name in names if name not in partner]
    for organ in organs:
        if organ.organ in partner or not left:
            continue
        positions = organ.displacement.sensors.positions
        far = {name: np.linalg.norm(_middle_of(name, imposed) - positions.mean(axis=0)) for name in left}
        nearest = min(left, key=lambda name: far[name])
        if far[nearest] <= SAME_PLACE * np.linalg.norm(np.ptp(positions, axis=0)):
            partner[organ.organ] = nearest
            left.remove(nearest)
    return partner


def _middle_of(name: str, imposed: Sequence[_Imposed]) -> np.ndarray:
    return next(each.mode.points.mean(axis=0) for each in imposed if each.mode.organ == name)


def _thinned(organ: OrganResult) -> OrganResult:
    """The organ at an even choice of its sensors: enough to compare shapes."""
    displacement, count = organ.displacement, len(organ.displacement.sensors.positions)
    if count <= MOST_SENSORS:
        return organ
    kept = np.linspace(0, count - 1, MOST_SENSORS).round().astype(int)
    axes = len(displacement.directions)
    sensors = replace(displacement.sensors, positions=displacement.sensors.positions[kept])
    basis = displacement.basis[(axes * kept[:, None] + np.arange(axes)).ravel()]
    return replace(
        organ,
        displacement=replace(displacement, basis=basis, sensors=sensors),
        model=replace(organ.model, mode_shapes=organ.model.mode_shapes[kept]),
    )


def _as_imposed(organ: OrganResult) -> list[_Imposed]:
    model = organ.model
    return [
        _Imposed(mode=mode, frequency_std=_known(frequency_std), damping_std=_known(damping_std))
        for mode, frequency_std, damping_std in zip(
            modes_as_truth(_thinned(organ)), model.frequency_stds, model.damping_stds, strict=True
        )
    ]


def _known(std: float) -> float | None:
    return float(std) if np.isfinite(std) else None


def _deviations(
    true: float | None, found: float | None, true_std: float | None, found_std: float | None
) -> float | None:
    if true is None or found is None or true_std is None or found_std is None:
        return None
    spread = float(np.hypot(true_std, found_std))
    return abs(found - true) / spread if spread > 0 else None


def modes_as_truth(organ: OrganResult) -> list[TrueMode]:
    """A result's modes in the form of imposed ones, so that another result can be held against them."""
    vectors = np.einsum("sam,ac->mcs", organ.model.mode_shapes, organ.displacement.directions)
    return [
        TrueMode(
            organ=organ.organ,
            name=f"mode_{index + 1}",
            frequency=float(organ.model.frequencies[index]),
            damping_ratio=float(organ.model.damping_ratios[index]),
            points=_at_rest(organ.displacement),
            shape=vectors[index].T,
            coordinates=organ.model.coordinates[:, index],
        )
        for index in range(len(organ.model.frequencies))
    ]


def truth_at_sensors(organ: OrganResult, mode: TrueMode) -> Float[np.ndarray, " dofs"]:
    """The imposed shape where the organ's sensors are at rest, along their directions (not normalised)."""
    positions = _at_rest(organ.displacement)
    if organ.surface == "cylinder":
        axis = _axis_of(organ)
        vectors = _nearest(mode.points @ axis[:, None], mode.shape, positions @ axis[:, None])
    else:
        across = _across(organ)
        vectors = _interpolated(mode.points @ across, mode.shape, positions @ across)
    return np.asarray(vectors @ organ.displacement.directions.T).ravel()


def _at_rest(displacement: DisplacementMatrix) -> Float[np.ndarray, "sensors 3"]:
    """Where the sensors are in the mean over the record, as those of a fitted surface are given.

    Followed points, the only ones with three components, are given where the first frame shows them.
    """
    positions = displacement.sensors.positions
    if len(displacement.directions) < 3 or not displacement.valid[0]:
        return positions
    coefficients = displacement.coefficients[displacement.valid]
    moved = displacement.basis @ (coefficients.mean(axis=0) - coefficients[0])
    return np.asarray(positions + moved.reshape(len(positions), 3) @ displacement.directions)


def _true_side(organ: OrganResult, imposed: Sequence[_Imposed]) -> _Side:
    dofs = organ.model.mode_shapes.shape[0] * organ.model.mode_shapes.shape[1]
    shapes = [truth_at_sensors(organ, each.mode) for each in imposed]
    return _Side(imposed=tuple(imposed), shapes=np.stack(shapes, axis=1) if shapes else np.zeros((dofs, 0)))


def _rows(name: str, true: _Side, model: ModalModel) -> list[ComparisonRow]:
    found = model.mode_shapes.reshape(len(true.shapes), len(model.frequencies))
    likeness = mac_matrix(true.shapes, found)
    partner = dict(_pair_accepted_first(true, model, likeness))
    taken = set(partner.values())
    places: list[tuple[int | None, int | None]] = [(index, partner.get(index)) for index in range(len(true.imposed))]
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
    imposed = None if index is None else true.imposed[index]
    return ComparisonRow(
        organ=name,
        mode=number,
        truth_hz=None if imposed is None else imposed.mode.frequency,
        found_hz=None if found is None else float(model.frequencies[found]),
        truth_damping=None if imposed is None else imposed.mode.damping_ratio,
        found_damping=None if found is None else float(model.damping_ratios[found]),
        mac=None if index is None or found is None else float(likeness[index, found]),
        verdict=None if found is None else model.quality[found].verdict,
        truth_hz_std=None if imposed is None else imposed.frequency_std,
        found_hz_std=None if found is None else _known(model.frequency_stds[found]),
        truth_damping_std=None if imposed is None else imposed.damping_std,
        found_damping_std=None if found is None else _known(model.damping_stds[found]),
    )


def _missing(name: str, imposed: Sequence[_Imposed]) -> list[ComparisonRow]:
    """Imposed modes of an organ that the result does not have at all."""
    return [
        ComparisonRow(
            organ=name,
            mode=number,
            truth_hz=each.mode.frequency,
            found_hz=None,
            truth_damping=each.mode.damping_ratio,
            found_damping=None,
            mac=None,
            verdict=None,
            truth_hz_std=each.frequency_std,
            truth_damping_std=each.damping_std,
        )
        for number, each in enumerate(sorted(imposed, key=lambda each: each.mode.frequency), start=1)
    ]


def _axis_of(organ: OrganResult) -> np.ndarray:
    """The direction along a rod: across both directions that it is measured in, or along its sensors."""
    directions, positions = organ.displacement.directions, organ.displacement.sensors.positions
    if len(directions) == 2:
        return np.cross(directions[0], directions[1])
    return np.asarray(np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)[2][0])


def _nearest(points: np.ndarray, values: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Mean of the few nearest points' values, weighted by inverse distance."""
    count = min(NEIGHBOURS, len(points))
    found = spatial.cKDTree(points).query(targets, k=count)
    distances, places = (np.asarray(part).reshape(len(targets), count) for part in found)
    weights = 1.0 / (distances + 1e-9)
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("tk,tkc->tc", weights, values[places]))


def _across(organ: OrganResult) -> Float[np.ndarray, "3 2"]:
    """The organ's own plane: across its one measuring direction, along which truth points may be noisy."""
    positions, directions = organ.displacement.sensors.positions, organ.displacement.directions
    spread = positions - positions.mean(axis=0) if len(directions) > 1 else directions
    axes = np.linalg.svd(spread)[2]
    return np.asarray(axes[:2].T if len(directions) > 1 else axes[1:].T)


def _interpolated(
    flat: Float[np.ndarray, "points 2"], values: np.ndarray, targets: Float[np.ndarray, "sensors 2"]
) -> np.ndarray:
    """Smooth pieces between points of a plane (Clough and Tocher); a thin plate reaches a little over their edge."""
    flat, places = np.unique(np.round(flat, 6), axis=0, return_index=True)
    extents = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    if len(flat) < PLATE_POINTS or extents[1] < 1e-3 * extents[0]:
        return _nearest(flat, values[places], targets)
    result = np.asarray(interpolate.CloughTocher2DInterpolator(flat, values[places])(targets))
    outside = ~np.isfinite(result).all(axis=1)
    if outside.any():
        plate = interpolate.RBFInterpolator(flat, values[places], neighbors=PLATE_POINTS, smoothing=PLATE_SMOOTHING)
        result[outside] = plate(targets[outside])
    return result
