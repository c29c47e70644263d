"""The structures that can be simulated, by name."""

from nerfmodal.simulate.palm import acai
from nerfmodal.simulate.plants import Plant
from nerfmodal.spec import SimulationSource


def plant_of(source: SimulationSource) -> Plant:
    """The structure that the source films, at rest. Raises `InvalidSpec` for a palm that cannot be."""
    return acai(source.palm)
