"""Write the generated pages of this folder from the code: `python docs/reference/generate.py` (or `make docs`).

Generated: spec.md (from `ScanSpec`), outcomes.md (from the enums and exceptions), settings.md (from `Settings`),
endpoints.md (from the OpenAPI document), commands.md (from the command line). A test in tests/architecture holds them
to the code.
"""

import ast
import inspect
import sys
import typing
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

from nerfmodal import errors, spec, types
from pydantic import BaseModel
from pydantic.fields import FieldInfo

HERE = Path(__file__).parent
WRITTEN_BY = "<!-- Written by docs/reference/generate.py: change the code, then type `make docs`. -->\n"


def spec_page() -> str:
    """Every key of a specification, its type, bounds and default."""
    head = (
        "# The specification\n\nYAML or JSON on the command line, JSON over HTTP. Unknown keys are refused, and every "
        "refusal names the key (a JSON pointer) and what to change. SI units, said in the key.\n"
    )
    rooms = [vars(sys.modules[f"{spec.__name__}.{room}"]) for room in ("parts", "simulation", "capture", "scan")]
    parts = (part for room in rooms for part in room.values() if inspect.isclass(part) and issubclass(part, spec.Part))
    sections = {part: _part(part) for part in parts if part is not spec.Part}
    return "\n".join([WRITTEN_BY, head, *reversed(sections.values())])


def outcomes_page() -> str:
    """What a result says of itself, and what can go wrong."""
    tables = [
        "# Outcomes, verdicts, reasons and errors\n",
        "## Outcomes\n\nA poor but usable result is a value, stored and served, not an error.\n\n"
        + _enum(types.Outcome),
        "## Reasons\n\nWhy a mode is doubtful or rejected.\n\n" + _enum(types.Reason),
        "## Errors\n\nEach names the field or file (`where`) and the remedy (`hint`).\n\n" + _errors(),
    ]
    return "\n".join([WRITTEN_BY, *tables])


def settings_page() -> str:
    """Every environment variable of the service."""
    from scanjobs.settings import Settings

    head = "# Settings\n\nRead once when a process starts. The defaults are the embedded service.\n"
    rows = [
        f"| `NERFMODAL_{name.upper()}` | {_default(field)} | {_cell(text)} |"
        for (name, field), text in zip(Settings.model_fields.items(), _field_docs(Settings), strict=True)
    ]
    return "\n".join([WRITTEN_BY, head, "| variable | default | meaning |", "|---|---|---|", *rows, ""])


def endpoints_page() -> str:
    """Every route of the API, from its OpenAPI document."""
    head = (
        "# Endpoints\n\nOpenAPI 3.1 is served at `/openapi.json`, a page to try it at `/docs`. Errors are RFC 9457 "
        "`application/problem+json` with a stable `code`.\n"
    )
    rows = [f"| `{method}` | `{path}` | {_cell(words)} |" for method, path, words in _routes()]
    return "\n".join([WRITTEN_BY, head, "| method | path | what |", "|---|---|---|", *rows, ""])


def commands_page() -> str:
    """Every command with its arguments and options."""
    head = (
        "# Commands\n\n`nerfmodal COMMAND --help` says the same. Exit codes: [exit-codes.md](exit-codes.md). Long work "
        "shows a progress bar on a terminal.\n"
    )
    return "\n".join([WRITTEN_BY, head, *(_command(name, command) for name, command in commands())])


def commands() -> Iterator[tuple[str, Any]]:
    """The name of each command (`scans list`) and the command."""
    import typer.main

    from services.cli.main import app

    yield from _leaves(typer.main.get_command(app), "")


PAGES: dict[str, Callable[[], str]] = {
    "spec.md": spec_page,
    "outcomes.md": outcomes_page,
    "settings.md": settings_page,
    "endpoints.md": endpoints_page,
    "commands.md": commands_page,
}


def _leaves(group: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _leaves(command, f"{prefix}{name} ")
        else:
            yield f"{prefix}{name}", command


def _command(name: str, command: Any) -> str:
    example = f"\n```sh\n{command.epilog.removeprefix('Example: ')}\n```\n" if command.epilog else ""
    shown = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    rows = [f"| `{_spelling(parameter)}` | {_cell(getattr(parameter, 'help', None) or '')} |" for parameter in shown]
    table = ["| argument or option | meaning |", "|---|---|", *rows, ""] if rows else []
    return "\n".join([f"## `nerfmodal {name}`\n\n{inspect.cleandoc(command.help or '')}\n{example}", *table])


def _spelling(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return parameter.name.upper()
    return ", ".join([*parameter.opts, *parameter.secondary_opts])


def _part(part: type[BaseModel]) -> str:
    title = f"## {part.__name__}\n\n{inspect.cleandoc(part.__doc__ or '')}\n"
    rows = [
        f"| `{name}` | {_type(field.annotation)}{_bounds(field)} | {_default(field)} | {_cell(text)} |"
        for (name, field), text in zip(part.model_fields.items(), _field_docs(part), strict=True)
    ]
    return "\n".join([title, "| key | type | default | meaning |", "|---|---|---|---|", *rows, ""])


def _field_docs(part: type[BaseModel]) -> Iterator[str]:
    """The string that stands below each field in the source, or nothing."""
    body = ast.parse(inspect.cleandoc("\n" + inspect.getsource(part))).body[0]
    assert isinstance(body, ast.ClassDef)
    followers = dict(zip(body.body, body.body[1:] + [None], strict=True))
    docs = {
        node.target.id: _string(followers[node])
        for node in body.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    return (docs.get(name, "") for name in part.model_fields)


def _string(node: ast.stmt | None) -> str:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return inspect.cleandoc(node.value.value)
    return ""


def _type(annotation: Any) -> str:
    if annotation is None or annotation is type(None):
        return "null"
    arguments = typing.get_args(annotation)
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _type(arguments[0])
    if origin is typing.Literal:
        return " or ".join(f"`{value}`" for value in arguments)
    if origin is tuple:
        return f"list of {_type(arguments[0])}" if arguments[-1] is ... else f"{len(arguments)} × {_type(arguments[0])}"
    if origin is dict:
        return f"{_type(arguments[1])} by {_type(arguments[0])}"
    if arguments:
        return " or ".join(_type(argument) for argument in arguments)
    name = getattr(annotation, "__name__", str(annotation))
    return f"[{name}](#{name.lower()})" if inspect.isclass(annotation) and issubclass(annotation, BaseModel) else name


def _bounds(field: FieldInfo) -> str:
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = [f"{signs[key]} {value}" for entry in _metadata(field) for key, value in _limits(entry) if key in signs]
    return f", {', '.join(found)}" if found else ""


def _metadata(field: FieldInfo) -> Iterator[Any]:
    yield from field.metadata
    for argument in (field.annotation, *typing.get_args(field.annotation)):
        for entry in getattr(argument, "__metadata__", ()):
            yield from getattr(entry, "metadata", (entry,))


def _limits(entry: Any) -> Iterator[tuple[str, float]]:
    return (
        (key, getattr(entry, key))
        for key in ("gt", "ge", "lt", "le")
        if isinstance(getattr(entry, key, None), int | float)
    )


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    if field.default_factory is not None:
        return "depends on the machine"
    if isinstance(field.default, BaseModel):
        return "its defaults"
    if isinstance(field.default, tuple):
        return f"`{[_plain(item) for item in field.default]}`"
    return "–" if field.default in (None, "") else f"`{_plain(field.default)}`"


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _enum(kind: type[Enum]) -> str:
    return "\n".join(["| code | meaning |", "|---|---|", *(f"| `{item.name}` | {item.value} |" for item in kind), ""])


def _errors() -> str:
    kinds = [
        kind for kind in vars(errors).values() if inspect.isclass(kind) and issubclass(kind, errors.NerfmodalError)
    ]
    rows = [f"| `{kind.code}` | `{kind.__name__}` | {_cell(kind.__doc__ or '')} |" for kind in kinds]
    return "\n".join(["| code | exception | meaning |", "|---|---|---|", *rows, ""])


def _routes() -> Iterator[tuple[str, str, str]]:
    for path, methods in sorted(_openapi()["paths"].items()):
        for method, operation in methods.items():
            yield method.upper(), path, operation.get("description") or operation.get("summary", "")


def _openapi() -> dict[str, Any]:
    from tempfile import TemporaryDirectory

    from scanjobs.settings import Settings

    from services.api.app import create_app

    with TemporaryDirectory() as folder:
        return create_app(Settings(data_folder=Path(folder))).openapi()


if __name__ == "__main__":
    for name, page in PAGES.items():
        (HERE / name).write_text(page())
