"""What is wrong with a specification, in words: pydantic's errors as pointer, message and remedy.

Shared by the API (problem+json) and the command line (exit code 3); imports nothing but pydantic and the spec.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, get_args

from nerfmodal.spec import (
    AirPulse,
    CameraDistance,
    CaptureSource,
    Checkerboard,
    CloudsSource,
    FreeDecay,
    Harmonic,
    PointDistance,
    ScanSpec,
    SimulationSource,
    Wind,
)
from pydantic import BaseModel, ValidationError

KINDS: Mapping[str, Mapping[str, type[BaseModel]]] = {
    "source": {"simulation": SimulationSource, "capture": CaptureSource, "clouds": CloudsSource},
    "excitation": {"free_decay": FreeDecay, "harmonic": Harmonic, "wind": Wind, "pulse": AirPulse},
    "scale": {"cameras": CameraDistance, "points": PointDistance, "checkerboard": Checkerboard},
}
"""Keys whose value says by `kind` what it is."""
LEADING_KEY = re.compile(r"^(\w+(?:\[\d+\])?(?:\.\w+(?:\[\d+\])?)*)(?=: | = )(?:: )?")
"""The field a validator's message begins with: 'motion[0].frequency_hz = …' or 'organs: …'."""

UNION_MEMBER = re.compile(r"[A-Z]\w*$|literal\[|[a-z-]+\[|(?:float|int|str|bool)$")
"""What pydantic calls a member of a union: a class, a type with brackets, or a plain one."""

REMEDIES: Mapping[str, str] = {
    "missing": "Add it.",
    "greater_than": "Give a value above {gt:g}.",
    "greater_than_equal": "Give a value of at least {ge:g}.",
    "less_than": "Give a value below {lt:g}.",
    "less_than_equal": "Give a value of at most {le:g}.",
    "finite_number": "Give a finite number.",
    "literal_error": "Use one of: {expected}.",
    "union_tag_invalid": "Use one of: {expected_tags}.",
    "union_tag_not_found": "Add 'kind'.",
    "string_too_short": "Give at least {min_length} character.",
    "string_too_long": "Give at most {max_length} characters.",
    "string_pattern_mismatch": "Use letters, digits, '_', '.' and '-', beginning with a letter or digit.",
    "tuple_type": "Give a list.",
    "too_short": "Give at least {min_length} values.",
    "too_long": "Give at most {max_length} values.",
    "model_type": "Give an object with keys and values.",
    "model_attributes_type": "Give an object with keys and values.",
}
WRONG_TYPE = "Give a value of the type that GET /v1/options (nerfmodal presets) shows."


@dataclass(frozen=True, slots=True, kw_only=True)
class Complaint:
    """One thing that is wrong: where (JSON pointer), what, and what to change."""

    pointer: str
    message: str
    hint: str


def complaints_of(error: ValidationError) -> tuple[Complaint, ...]:
    """What pydantic found wrong with a specification."""
    return complaints([dict(row) for row in error.errors(include_url=False, include_input=False)])


def complaints(rows: Iterable[Mapping[str, Any]], *, of_scan: bool = True) -> tuple[Complaint, ...]:
    """The same, from the rows of `ValidationError.errors()`, of a specification or of another body."""
    found = list(rows)
    plain = [{**row, "loc": _without_members(row)} for row in found if not _is_lesser(row, found)]
    return tuple(_complaint(row) if of_scan else _foreign_complaint(row) for row in plain)


def json_pointer(path: Iterable[str | int]) -> str:
    """RFC 6901."""
    return "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in path)


def _without_members(row: Mapping[str, Any]) -> tuple[str | int, ...]:
    """Pydantic puts the member of a union ('Box', "literal['auto']") behind its key; the document has no such key."""
    if not row["loc"]:
        return ()
    *way, last = row["loc"]
    kept = [part for part in way if not _is_member(part)]
    own = row["type"] == "extra_forbidden" or not _is_member(last)
    return (*kept, last) if own else tuple(kept)


def _is_member(part: str | int) -> bool:
    return isinstance(part, str) and UNION_MEMBER.match(part) is not None


def _is_lesser(row: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> bool:
    """Whether it says 'or this word', where another member of the union was meant and is wrong further down."""
    if not row["loc"] or not str(row["loc"][-1]).startswith("literal["):
        return False
    way = row["loc"][:-1]
    return any(other is not row and tuple(other["loc"][: len(way)]) == tuple(way) for other in rows)


def _foreign_complaint(row: Mapping[str, Any]) -> Complaint:
    """Of a body that is no specification."""
    if row["type"] == "value_error":
        return _from_validator(tuple(row["loc"]), str(row["ctx"]["error"]))
    if row["type"] == "extra_forbidden":
        return Complaint(pointer=json_pointer(row["loc"]), message="is no key here.", hint="Remove it; see /docs.")
    hint = _remedy(row).replace("GET /v1/options (nerfmodal presets)", "/docs")
    return Complaint(pointer=json_pointer(row["loc"]), message=_message(row), hint=hint)


def _complaint(row: Mapping[str, Any]) -> Complaint:
    path = _without_tag(tuple(row["loc"]))
    if row["type"] == "value_error":
        return _from_validator(path, str(row["ctx"]["error"]))
    if row["type"] == "extra_forbidden":
        return Complaint(pointer=json_pointer(path), message="is no key of a scan.", hint=_keys_there(row["loc"]))
    if str(row["type"]).startswith("union_tag"):
        return _untold_kind(path, row)
    return Complaint(pointer=json_pointer(path), message=_message(row), hint=_remedy(row))


def _untold_kind(path: tuple[str | int, ...], row: Mapping[str, Any]) -> Complaint:
    key = str(path[-1]) if path else "source"
    told = row["type"] == "union_tag_invalid"
    hint = _remedy(row) if told else f"Add 'kind': one of {', '.join(KINDS.get(key, {}))}."
    message = f"is no kind of {key}." if told else "is required."
    return Complaint(pointer=json_pointer((*path, "kind")), message=message, hint=hint)


def _message(row: Mapping[str, Any]) -> str:
    known = {
        "missing": "is required.",
    }
    text = str(row["msg"]).removeprefix("Input ").removeprefix("String ").removeprefix("Value ")
    return known.get(str(row["type"]), f"{text}.")


def _without_tag(loc: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """Pydantic puts the kind behind the key that has one ('source', 'simulation'); the document has no such key."""
    return tuple(part for place, part in enumerate(loc) if not _is_kind(loc, place))


def _is_kind(loc: tuple[str | int, ...], place: int) -> bool:
    return place > 0 and str(loc[place]) in KINDS.get(str(loc[place - 1]), {})


def _from_validator(path: tuple[str | int, ...], text: str) -> Complaint:
    """A validator of the spec writes 'key = value is wrong; remedy'."""
    message, _, hint = text.partition("; ")
    named = LEADING_KEY.match(message)
    below = re.findall(r"\w+", named[1]) if named else []
    if named and named[0].endswith(": "):
        message = message[named.end() :]
    pointer = json_pointer(path + tuple(below))
    remedy = f"{hint[:1].upper()}{hint[1:]}." if hint else "Correct the value."
    return Complaint(pointer=pointer, message=f"{message}.", hint=remedy)


def _remedy(row: Mapping[str, Any]) -> str:
    remedy = REMEDIES.get(str(row["type"]), WRONG_TYPE)
    return remedy.format_map(row.get("ctx") or {})


def _keys_there(loc: tuple[str | int, ...]) -> str:
    """The keys that may stand where an unknown one stood, the most similar one first."""
    unknown, keys = str(loc[-1]), _keys_of(_model_at(loc[:-1]))
    close = get_close_matches(unknown, keys, n=1)
    guess = f"Did you mean '{close[0]}'? " if close else ""
    return f"{guess}The keys here are: {', '.join(keys)}." if keys else "Remove it."


def _keys_of(model: type[BaseModel] | None) -> list[str]:
    return list(model.model_fields) if model else []


def _model_at(path: Iterable[str | int]) -> type[BaseModel] | None:
    """The part of the specification that pydantic's path leads to."""
    model: type[BaseModel] | None = ScanSpec
    way = tuple(path)
    for place, part in enumerate(way):
        if isinstance(part, int) or model is None:
            continue
        model = KINDS[str(way[place - 1])][part] if _is_kind(way, place) else _below(model, part)
    return model


def _below(model: type[BaseModel], key: str) -> type[BaseModel] | None:
    if key in KINDS:
        return model  # its kind comes next
    field = model.model_fields.get(key)
    return _first_model(field.annotation) if field else None


def _first_model(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _first_model(part))), None)
