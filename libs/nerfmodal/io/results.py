"""A `ScanResult` as one .npz: arrays under their path in the tree, everything else as one JSON string."""

import dataclasses
import json
import types
import typing
import zipfile
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from nerfmodal.errors import InvalidInput
from nerfmodal.io.atomic import atomic_write
from nerfmodal.types import ScanResult


def write_result(path: Path, result: ScanResult) -> None:
    """Write a result."""
    arrays: dict[str, np.ndarray] = {}
    tree = _pack(result, "", arrays)
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, tree=np.array(json.dumps(tree)), **arrays)


def read_result(path: Path) -> ScanResult:
    """Read a result. Raises `InvalidInput` when the file is none."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            tree = json.loads(str(archive["tree"]))
            result = _unpack(ScanResult, tree, archive)
    except (OSError, KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidInput(f"is no result ({error}).", where=str(path), hint="Identify the scan again.") from error
    assert isinstance(result, ScanResult)
    return result


def _pack(value: Any, place: str, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays[place] = value
        return place
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple):
        return [_pack(item, f"{place}/{index}", arrays) for index, item in enumerate(value)]
    if dataclasses.is_dataclass(value):
        names = (field.name for field in dataclasses.fields(value))
        return {name: _pack(getattr(value, name), f"{place}/{name}".lstrip("/"), arrays) for name in names}
    return value


def _unpack(kind: Any, tree: Any, archive: Any) -> Any:
    """Rebuild a value of the annotated type `kind`: the types themselves are the schema."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return None if tree is None else _unpack(typing.get_args(kind)[0], tree, archive)
    if typing.get_origin(kind) is tuple:
        return tuple(_unpack(typing.get_args(kind)[0], item, archive) for item in tree)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind[tree]
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return kind(  # type: ignore[operator]
            **{name: _unpack(hints[name], item, archive) for name, item in tree.items()}
        )
    return archive[tree] if hasattr(kind, "array_type") else tree
