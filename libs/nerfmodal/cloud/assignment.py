"""Which found organ is which of the specification's: by name, kind and size."""

from collections.abc import Mapping, Sequence

from nerfmodal.cloud.organs import FoundOrgan
from nerfmodal.errors import InvalidClouds
from nerfmodal.spec import OrganSpec

ROD_DEGREE = 4
SHEET_DEGREE = 5


def specify(found: Sequence[FoundOrgan]) -> tuple[tuple[OrganSpec, ...], Mapping[str, FoundOrgan]]:
    """Specifications of organs that nobody named, and where each is.

    One organ alone is the whole cloud: nothing is cut off it.
    """
    if len(found) < 2:
        rod = bool(found) and found[0].kind == "rod"
        return (_organ("whole", rod),), {}
    return tuple(_organ(one.name, one.kind == "rod") for one in found), {one.name: one for one in found}


def assign(given: Sequence[OrganSpec], found: Sequence[FoundOrgan]) -> Mapping[str, FoundOrgan]:
    """The found organ of each given one whose region is 'auto': the largest of its kind that is left.

    Raises
    ------
    InvalidClouds
        More organs of a kind are asked for than were found.
    """
    left = sorted(found, key=lambda one: -int(one.space.sum()))
    chosen = {}
    for organ in given:
        if organ.region != "auto":
            continue
        kind = "rod" if organ.surface == "cylinder" else "sheet"
        mine = next((one for one in left if one.kind == kind), None)
        if mine is None:
            names = ", ".join(one.name for one in found) or "nothing"
            raise InvalidClouds(
                f"no {kind} is left for organ '{organ.name}': found were {names}.",
                where=f"/organs/{organ.name}/region",
                hint="Give it a box, or another surface (cylinder for a rod).",
            )
        left.remove(mine)
        chosen[organ.name] = mine
    return chosen


def _organ(name: str, rod: bool) -> OrganSpec:
    surface = OrganSpec(name=name, surface="cylinder", degree=ROD_DEGREE)
    return surface if rod else OrganSpec(name=name, surface="polynomial", degree=SHEET_DEGREE)
