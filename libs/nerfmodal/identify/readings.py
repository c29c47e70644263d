"""A method's reading of a record, in principal components; and which readings agree on a mode.

Methods are compared by frequency and MAC. Local shapes (columns over the leading components) have the MAC of the
shapes themselves, because the components are orthonormal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.metrics import mac_matrix, pair
from nerfmodal.identify.reduction import PrincipalAxes
from nerfmodal.identify.shapes import unit_max
from nerfmodal.types import Diagram, DisplacementMatrix, Opinion

ALIKE = 0.8
"""MAC from which two methods are said to agree on a mode."""
AGREE_SHARE = 0.03
"""They may differ in frequency by this share, or by half a line's width (0.5 / record length)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The displacement of an organ and its principal axes."""

    displacement: DisplacementMatrix
    axes: PrincipalAxes

    @property
    def duration(self) -> float:
        """Length of the record, seconds: the last frame lasts as long as the others."""
        times = self.displacement.times
        return float(times[-1] - times[0]) + 1.0 / self.displacement.frame_rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Modes as one method reads them: Hz, 0-1, shapes of largest element +1, coordinates in metres.

    `local` holds the shapes over the leading components: `shapes` = U @ `local`.
    """

    method: str
    frequencies: Float[np.ndarray, " modes"]
    damping_ratios: Float[np.ndarray, " modes"]
    local: Float[np.ndarray, "kept modes"]
    shapes: Float[np.ndarray, "dofs modes"]
    coordinates: Float[np.ndarray, "frames modes"]
    diagram: Diagram | None = None

    def opinion(self, displacement: DisplacementMatrix) -> Opinion:
        """The reading as it is kept in the result."""
        sensors, axes = len(displacement.sensors.positions), len(displacement.directions)
        return Opinion(
            method=self.method,
            frequencies=self.frequencies,
            damping_ratios=self.damping_ratios,
            mode_shapes=self.shapes.reshape(sensors, axes, len(self.frequencies)),
            coordinates=self.coordinates,
            diagram=self.diagram,
        )


def normalised(
    axes: PrincipalAxes, local: Float[np.ndarray, "kept modes"]
) -> tuple[Float[np.ndarray, "kept modes"], Float[np.ndarray, "dofs modes"], Float[np.ndarray, " modes"]]:
    """Local and full shapes whose largest element is +1, and the factors they were divided by."""
    shapes, factors = unit_max(axes.lift(local))
    return local / factors, shapes, factors


def agreement(main: Reading, other: Reading, duration: float) -> list[float | None]:
    """For every mode of `main`, the MAC with the mode of `other` at its frequency; None if there is none alike."""
    likeness = mac_matrix(*_as_long(main.local, other.local))
    width = max(0.5 / duration, AGREE_SHARE * float(main.frequencies.max(initial=0.0)))
    paired = dict(pair(main.frequencies, other.frequencies, likeness, within_hz=width))
    found: list[float | None] = []
    for mode, frequency in enumerate(main.frequencies):
        partner = paired.get(mode)
        if partner is None:
            found.append(None)
            continue
        near = abs(other.frequencies[partner] - frequency) <= max(AGREE_SHARE * frequency, 0.5 / duration)
        found.append(float(likeness[mode, partner]) if near and likeness[mode, partner] >= ALIKE else None)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Consensus:
    """Which other methods see a mode, and the best MAC with them (None where none does)."""

    methods: tuple[str, ...]
    mac: float | None


def consensus(main: Reading, others: Sequence[Reading], duration: float) -> list[Consensus]:
    """What the other methods say of every mode of `main`."""
    heard = [(other.method, agreement(main, other, duration)) for other in others]
    found = []
    for mode in range(len(main.frequencies)):
        said = {method: alike[mode] for method, alike in heard if alike[mode] is not None}
        found.append(Consensus(methods=tuple(said), mac=max((mac for mac in said.values() if mac), default=None)))
    return found


def _as_long(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both over the same components: those that one method left out are zero."""
    rows = max(len(first), len(second))
    longer = [np.vstack([each, np.zeros((rows - len(each), each.shape[1]))]) for each in (first, second)]
    return longer[0], longer[1]
