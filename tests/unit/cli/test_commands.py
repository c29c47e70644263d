"""Every command: help with an example, exit codes, messages that name the key and the remedy."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from nerfmodal import pipeline
from nerfmodal.errors import InvalidCapture, MissingExtra, TrainingDiverged
from nerfmodal.export.modes import write_json
from nerfmodal.pipeline import Progress
from nerfmodal.spec import CloudsSource, ScanSpec
from typer.main import get_command

from services.cli import doctor
from services.cli.main import app
from tests.unit.cli.conftest import SPEC, Call


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every command's words."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name)


ALL = sorted(commands(get_command(app)))


def test_the_promised_commands_are_there() -> None:
    scans = {words[1] for words in ALL if words[0] == "scans"}
    assert {words[0] for words in ALL} >= {"run", "simulate", "reconstruct", "identify", "compare", "up", "doctor"}
    assert scans >= {
        "submit",
        "list",
        "show",
        "watch",
        "cancel",
        "retry",
        "fork",
        "modes",
        "download",
        "upload",
        "logs",
    }


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_every_command_shows_an_example_of_itself(call: Call, words: tuple[str, ...]) -> None:
    shown = call(*words, "--help")
    assert shown.exit_code == 0
    assert f"Example: nerfmodal {' '.join(words)}" in " ".join(shown.output.split())


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", "a", "--wings", "2"], ["up", "--port", "x"]])
def test_wrong_usage_is_2(call: Call, arguments: list[str]) -> None:
    assert call(*arguments).exit_code == 2


def test_help_imports_nothing_heavy() -> None:
    heavy = {"torch", "open3d", "bpy", "numba", "httpx", "uvicorn", "fastapi", "celery", "sqlalchemy", "scipy"}
    code = f"import sys, services.cli.main; print(sorted({heavy!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


BAD = [
    ("frames: 3", "frams: 3", 4, "/source/frams", "Did you mean 'frames'?"),
    ("frames: 3", "frames: 0", 4, "/source/frames", "at least 1"),
    ("frequency_hz: 1,", "frequency_hz: 20,", 7, "/source/motion/0/frequency_hz", "frame_rate_hz >= 44.44"),
    ("name: small", "name: small\ncolour: red", 2, "/colour", "keys here"),
    ("  frame_rate_hz: 30\n", "", 2, "/source/frame_rate_hz", "Add it"),
]


@pytest.mark.parametrize(("old", "new", "line", "pointer", "remedy"), BAD, ids=[row[3] for row in BAD])
def test_a_bad_key_is_3_with_its_line_and_remedy(
    call: Call, spec: Path, old: str, new: str, line: int, pointer: str, remedy: str
) -> None:
    spec.write_text(SPEC.replace(old, new))
    done = call("run", spec)
    assert done.exit_code == 3
    assert f"{spec}:{line} {pointer}: " in done.stderr
    assert remedy in done.stderr
    assert done.stdout == ""


def test_every_fault_is_told_and_machines_get_json(call: Call, spec: Path) -> None:
    spec.write_text(SPEC.replace("frames: 3", "frames: 0") + "colour: red\n")
    done = call("run", spec, "--json")
    said = json.loads(done.stderr)
    assert (done.exit_code, said["code"]) == (3, "INVALID_SPEC")
    assert len(said["errors"]) == 2


@pytest.mark.parametrize("content", ["a: [1,\nb: 2", "\x00", "- just\n- a list", "", "!!python/object:os.system {}"])
def test_a_file_that_is_no_specification_is_3(call: Call, spec: Path, content: str) -> None:
    spec.write_text(content)
    done = call("run", spec)
    assert done.exit_code == 3
    assert str(spec) in done.stderr


def test_a_missing_file_is_3(call: Call) -> None:
    done = call("run", "nowhere.yaml")
    assert done.exit_code == 3
    assert "nowhere.yaml: cannot be read: No such file" in done.stderr


def test_json_is_read_as_well(call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[ScanSpec] = []

    def run(spec: ScanSpec, out: Path, **_: object) -> None:
        seen.append(spec)
        publish_nothing(out)

    monkeypatch.setattr(pipeline, "run", run)
    path = tmp_path / "spec.json"
    path.write_text(json.dumps({"source": {"kind": "clouds", "path": "x"}}))
    assert call("run", path).exit_code == 0
    assert seen[0].source == CloudsSource(kind="clouds", path="x")


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (MissingExtra("bpy", "simulate"), 1, "pip install 'nerfmodal[simulate]'"),
        (TrainingDiverged("The loss is no number.", hint="Lower it."), 1, "The loss is no number."),
        (InvalidCapture("is cut off.", where="images/1.png", hint="Copy it."), 3, "images/1.png: is cut off."),
    ],
)
def test_what_the_science_raises_has_its_exit_code(
    call: Call, spec: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, code: int, words: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(pipeline, "run", fail)
    done = call("run", spec)
    assert done.exit_code == code
    assert words in done.stderr
    assert "Traceback" not in done.output


def test_what_nobody_foresaw_is_not_hidden(call: Call, spec: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(pipeline, "run", fail)
    done = call("run", spec)
    assert done.exit_code == 1
    assert isinstance(done.exception, ZeroDivisionError)


def publish_nothing(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    write_json({"organs": [], "outcome": "TOO_FEW_FRAMES", "message": "Fewer than 16."}, out / "modes.json")


def test_run_says_where_the_results_are_and_draws_no_bar_without_a_terminal(
    call: Call, spec: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(_: object, out: Path, *, report: Any) -> None:
        report("render", Progress(done=1, total=2))
        publish_nothing(out)

    monkeypatch.setattr(pipeline, "run", run)
    done = call("run", spec)
    assert done.exit_code == 0
    assert "Fewer than 16." in done.stdout
    assert "out/small" in done.stdout
    assert done.stderr.strip() == ""
    machine = call("run", spec, "--json", "--out", "elsewhere")
    assert json.loads(machine.stdout)["out"] == "elsewhere"


def test_presets_are_printed_as_specifications_that_can_be_run(call: Call) -> None:
    assert "quick" in call("presets").stdout
    ScanSpec.model_validate(yaml.safe_load(call("presets", "quick").stdout))
    ScanSpec.model_validate(json.loads(call("presets", "quick", "--json").stdout))
    assert "properties" in json.loads(call("presets", "--options").stdout)
    assert call("presets", "nothing").exit_code == 3


def test_doctor_tells_wheels_that_are_missing_or_broken(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = (
        doctor.Part(module="yaml", package="PyYAML", extra=None, purpose="x"),
        doctor.Part(module="nothing", package="no-such-wheel", extra="vision", purpose="x"),
    )
    monkeypatch.setattr(doctor, "PARTS", parts)
    done = call("doctor", "--json")
    states = {row["part"]: (row["state"], row["remedy"]) for row in json.loads(done.stdout)["parts"]}
    assert done.exit_code == 0
    assert states == {"yaml": ("ok", ""), "nothing": ("missing", "pip install 'nerfmodal[vision]'")}
    broken = doctor.Part(module="no_such_module", package="PyYAML", extra=None, purpose="x")
    monkeypatch.setattr(doctor, "PARTS", (broken,))
    assert call("doctor").exit_code == 1


def test_a_worker_of_no_queue_is_3(call: Call) -> None:
    done = call("worker", "--queues", "trian")
    assert done.exit_code == 3
    assert "train" in done.stderr
