"""Write deploy/constraints.txt from this environment: `python deploy/pin.py`, after `make test` has passed in it.

Every package that the images' extras ask for, and what those ask for in turn, at the version installed here.
"""

import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement

DEPLOY = Path(__file__).parent
EXTRAS = ("vision", "simulate", "postgres", "s3", "telemetry")
HEAD = """# What the images install: versions that the tests have passed with, so that every build is the same.
# Written by deploy/pin.py.
"""


def pinned() -> dict[str, str]:
    """Package → version, of everything that the images may install."""
    project = tomllib.loads((DEPLOY.parent / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(text for extra in EXTRAS for text in project["optional-dependencies"][extra])]
    versions: dict[str, str] = {}
    _follow(map(Requirement, wanted), versions, set())
    return versions


def _follow(wanted: Iterable[Requirement], versions: dict[str, str], seen: set[tuple[str, frozenset[str]]]) -> None:
    for one in wanted:
        name, extras = re.sub(r"[-_.]+", "-", one.name).lower(), frozenset(one.extras)
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        found = distribution(one.name)
        versions[name] = found.version.split("+")[0]  # a build's own label, such as torch's +cpu, is not pinned
        needed = map(Requirement, found.requires or ())
        _follow((part for part in needed if _applies(part, extras)), versions, seen)


def _applies(one: Requirement, extras: frozenset[str]) -> bool:
    return one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in (*extras, ""))


if __name__ == "__main__":
    lines = [f"{name}=={version}\n" for name, version in sorted(pinned().items())]
    (DEPLOY / "constraints.txt").write_text(HEAD + "".join(lines))
