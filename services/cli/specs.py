"""Specifications from files: YAML or JSON (which is YAML). A fault names its key, its line and the remedy."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from nerfmodal.errors import InvalidSpec
from nerfmodal.spec import ScanSpec
from pydantic import ValidationError

from services.api.complaints import Complaint, complaints_of
from services.cli.outcomes import SpecRefused

SpecFile = Annotated[Path, typer.Argument(metavar="SPEC", help="A specification, YAML or JSON.", show_default=False)]


def read_spec(path: Path) -> ScanSpec:
    """The specification in a file.

    Raises
    ------
    InvalidSpec
        The file cannot be read or is no YAML; `SpecRefused` for each key that is wrong.
    """
    text = read_text(path)
    return parse_spec(load(text, path), text, path)


def parse_spec(document: Any, text: str, path: Path) -> ScanSpec:
    """A specification from a parsed file; `text` is only used to name lines."""
    try:
        return ScanSpec.model_validate(document)
    except ValidationError as error:
        raise SpecRefused([_located(complaint, text, path) for complaint in complaints_of(error)]) from error


def load(text: str, path: Path) -> Any:
    """The document in a text. Raises `InvalidSpec` with the line where it stops to be YAML."""
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "it cannot be parsed"
        raise InvalidSpec(f"is no YAML: {problem}.", where=f"{path}{line}", hint="Correct this line.") from error


def read_text(path: Path) -> str:
    """A text file. Raises `InvalidSpec`."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise InvalidSpec(f"cannot be read: {reason}.", where=str(path), hint="Give a YAML or JSON file.") from error


def line_of(text: str, pointer: str) -> int | None:
    """The line, from 1, of the key that a JSON pointer names, or of the last one on the way that is there."""
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    line: int | None = None
    for part in pointer.split("/")[1:]:
        found = _child(node, part)
        if found is None:
            break
        line, node = found
    return line


def _child(node: yaml.Node | None, part: str) -> tuple[int, yaml.Node] | None:
    if isinstance(node, yaml.MappingNode):
        pairs = [(key, value) for key, value in node.value if key.value == part]
        return (pairs[-1][0].start_mark.line + 1, pairs[-1][1]) if pairs else None
    if isinstance(node, yaml.SequenceNode) and part.isdigit() and int(part) < len(node.value):
        return node.value[int(part)].start_mark.line + 1, node.value[int(part)]
    return None


def _located(complaint: Complaint, text: str, path: Path) -> Complaint:
    line = line_of(text, complaint.pointer)
    place = f"{path}:{line}" if line else str(path)
    return replace(complaint, pointer=f"{place} {complaint.pointer}".rstrip())


def as_json(spec: ScanSpec) -> dict[str, Any]:
    """The specification as it goes over HTTP."""
    document: dict[str, Any] = spec.model_dump(mode="json")
    return document


def located(spec: ScanSpec) -> dict[str, Any]:
    """The same with a path that leads somewhere from here made absolute, for a service that runs elsewhere."""
    document = as_json(spec)
    source = document["source"]
    if "path" in source and Path(source["path"]).exists():
        source["path"] = str(Path(source["path"]).resolve())
    return document
