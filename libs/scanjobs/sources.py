"""Which paths of the service's machine a specification may name.

A path is followed through every symbolic link first; what it leads to must lie in one of the owner's roots: for the
operator (the owner `local`) the `capture_roots` themselves, for everybody else the folder of his name in each of them.
"""

from collections.abc import Sequence
from pathlib import Path

from nerfmodal.spec import ScanSpec, SimulationSource

from scanjobs.errors import SourceOutsideRoots
from scanjobs.repository import LOCAL_OWNER
from scanjobs.settings import Settings

FIELD = "/source/path"


def roots_of(settings: Settings, owner: str) -> tuple[Path, ...]:
    """The folders that an owner's specifications may name."""
    if owner == LOCAL_OWNER:
        return settings.capture_roots
    return tuple(root / owner for root in settings.capture_roots)


def resolve_source_path(settings: Settings, path: str, *, owner: str = LOCAL_OWNER) -> Path:
    """The real, existing path that `path` means; relative paths are looked for in each root.

    Raises
    ------
    SourceOutsideRoots
        It leads out of every root, or nothing is there.
    """
    roots = roots_of(settings, owner)
    if "\x00" in path:
        raise _refusal(roots, path, "contains a zero byte")
    for root in roots:
        found = _inside(root, path)
        if found is not None:
            return found
    raise _refusal(roots, path, "is not in a folder that captures are read from, or does not exist")


def confine_source(settings: Settings, spec: ScanSpec, *, owner: str = LOCAL_OWNER) -> ScanSpec:
    """The same specification with `source.path` resolved, as every worker can open it."""
    if isinstance(spec.source, SimulationSource):
        return spec
    path = resolve_source_path(settings, spec.source.path, owner=owner)
    return spec.model_copy(update={"source": spec.source.model_copy(update={"path": str(path)})})


def _inside(root: Path, path: str) -> Path | None:
    base = root.resolve()
    try:
        found = (base / path).resolve(strict=True)
    except (OSError, RuntimeError):
        return None
    return found if found.is_relative_to(base) else None


def _refusal(roots: Sequence[Path], path: str, reason: str) -> SourceOutsideRoots:
    listed = ", ".join(str(root.resolve()) for root in roots) or "none is set"
    return SourceOutsideRoots(
        f"the path {path!r} {reason}.",
        where=FIELD,
        hint=f"Put it in one of: {listed}; or upload it; or set NERFMODAL_CAPTURE_ROOTS.",
    )
