"""The digest of everything that a step's result depends on: equal digests mean equal results.

A step that looks at files of the user (`scan.inspect`, `frame.read`) has none: the files may have changed.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from types import MappingProxyType
from typing import Any, Final

from scanjobs.messages import EXTRACT, IDENTIFY, RENDER, TRAIN
from scanjobs.plan import StepKey

Input = tuple[str, int, str, str]
"""Kind and frame of a parent, role and digest of its file."""

RECONSTRUCTED: Final = ("source", "reconstruction", "organs", "seed")
PARTS_OF: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        RENDER: ("source", "seed"),
        TRAIN: RECONSTRUCTED,
        EXTRACT: RECONSTRUCTED,
        IDENTIFY: (*RECONSTRUCTED, "identification", "name", "plant", "tags"),
    }
)
"""What of the specification each kind of step may look at."""


def input_digest(spec: Mapping[str, Any], key: StepKey, inputs: Sequence[Input]) -> str | None:
    """SHA-256 of the step's name, its part of the specification, its input files and the program's version."""
    parts = PARTS_OF.get(key.kind)
    if parts is None:
        return None
    what = {
        "program": program_version(),
        "step": list(key),
        "spec": {part: spec[part] for part in parts},
        "inputs": sorted(inputs),
    }
    return hashlib.sha256(json.dumps(what, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@cache
def program_version() -> str:
    """The installed version: another one may compute otherwise."""
    return version("nerfmodal")
