"""`presets`: specifications to start from, and the schema of all options."""

from typing import Annotated, Any

import typer
import yaml
from nerfmodal.errors import InvalidInput
from nerfmodal.spec import ScanSpec, SimulationSource

from services.api.presets import PRESETS
from services.cli.output import Json, print_json, results, table_of
from services.cli.specs import as_json as json_of


def presets(
    name: Annotated[str | None, typer.Argument(help="Print this preset, as YAML.", show_default=False)] = None,
    options: Annotated[bool, typer.Option("--options", help="Print the JSON Schema of every option.")] = False,
    as_json: Json = False,
) -> None:
    """List the presets, print one as YAML, or print what every option means."""
    if options:
        print_json(ScanSpec.model_json_schema())
    elif name is not None:
        _print_preset(name, as_json=as_json)
    elif as_json:
        print_json({name: json_of(spec) for name, spec in PRESETS.items()})
    else:
        columns = ("preset", ">frames", ">cameras", "pictures", "renderer", "field")
        results().print(table_of(columns, [_row(name, spec) for name, spec in PRESETS.items()]))


def _print_preset(name: str, *, as_json: bool) -> None:
    if name not in PRESETS:
        raise InvalidInput(f"is no preset: '{name}'.", where="NAME", hint=f"Use one of: {', '.join(PRESETS)}.")
    document: dict[str, Any] = json_of(PRESETS[name])
    if as_json:
        print_json(document)
    else:
        typer.echo(yaml.safe_dump(document, sort_keys=False, allow_unicode=True), nl=False)


def _row(name: str, spec: ScanSpec) -> tuple[str, ...]:
    source = spec.source
    assert isinstance(source, SimulationSource)
    size = f"{source.rig.width_px} × {source.rig.height_px}"
    return name, str(source.frames), str(source.rig.cameras), size, source.renderer, spec.reconstruction.field
