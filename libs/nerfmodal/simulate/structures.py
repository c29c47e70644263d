"""The structures that can be simulated, by name."""

from nerfmodal.simulate.beams import plate, tower
from nerfmodal.simulate.herb import herb
from nerfmodal.simulate.palm import acai
from nerfmodal.simulate.plants import Plant
from nerfmodal.simulate.tree import tree
from nerfmodal.spec import SimulationSource


def plant_of(source: SimulationSource) -> Plant:
    """The structure that the source films, at rest. Raises `InvalidSpec` for a palm that cannot be."""
    match source.structure:
        case "acai":
            return acai(source.palm)
        case "herb":
            return herb()
        case "tree":
            return tree()
        case "plate":
            return plate()
        case "tower":
            return tower()
