"""The documents name what exists: pages that are generated are up to date, commands, files and functions are real."""

import ast
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")])
MAKEFILE = (ROOT / "Makefile").read_text()


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    place = importlib.util.spec_from_file_location("generate_reference", ROOT / "docs/reference/generate.py")
    assert place is not None
    assert place.loader is not None
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["spec.md", "outcomes.md", "settings.md", "endpoints.md", "commands.md"])
def test_generated_pages_are_up_to_date(generator: ModuleType, page: str):
    written = (ROOT / "docs/reference" / page).read_text()
    assert written == generator.PAGES[page](), "type: make docs"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_between_pages_lead_somewhere(page: Path):
    targets = re.findall(r"\]\((?!https?://|#|mailto:)([^)#\s]+)", page.read_text())
    assert [target for target in targets if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_make_targets_that_are_named_exist(page: Path):
    named = set(re.findall(r"(?:`|^)make ([a-z]+)", page.read_text(), flags=re.MULTILINE))
    targets = set(re.findall(r"^([a-z]+):", MAKEFILE, flags=re.MULTILINE))
    assert named <= targets


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_that_are_named_exist(page: Path, commands: set[str]):
    pattern = r"(?<!-n)(?:`|^|\s)nerfmodal ([a-z][a-z-]+)(?: ([a-z][a-z-]+))?"
    groups = {command.split()[0] for command in commands if " " in command}
    words = re.findall(pattern, code_of(page.read_text()), flags=re.MULTILINE)
    named = {f"{first} {second}" if first in groups and second else first for first, second in words}
    assert named <= commands | groups


def code_of(text: str) -> str:
    """What stands in code: fenced blocks and inline spans."""
    fenced = re.findall(r"```[a-z]*\n(.*?)```", text, flags=re.DOTALL)
    without = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return "\n".join([*fenced, *re.findall(r"`([^`\n]+)`", without)])


@pytest.fixture(scope="module")
def commands(generator: ModuleType) -> set[str]:
    return {name for name, _ in generator.commands()}


EQUATIONS = (ROOT / "docs/equations.md").read_text()
FUNCTIONS = re.findall(r"`((?:libs|services|docs)/[\w/]+\.py)::(\w+)`", EQUATIONS)
HOLDERS = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", EQUATIONS)


def test_every_equation_of_the_paper_is_mapped():
    rows = re.findall(r"^\| \(?(\d+)\)? \|", EQUATIONS, flags=re.MULTILINE)
    assert sorted({int(row) for row in rows}) == list(range(1, 19))


@pytest.mark.parametrize(("file", "function"), sorted(set(FUNCTIONS + HOLDERS)))
def test_functions_and_tests_of_the_equations_exist(file: str, function: str):
    assert (ROOT / file).exists()
    module = ast.parse((ROOT / file).read_text())
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    assert function in {node.name for node in ast.walk(module) if isinstance(node, kinds)}


def test_compose_file_names_real_files_and_services():
    compose = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
    services = compose["services"]
    assert {"postgres", "redis", "migrate", "api", "worker-train", "worker-render"} <= set(services)
    builds = [service["build"] for service in services.values() if "build" in service]
    assert all((ROOT / build["context"] / build["dockerfile"]).exists() for build in builds)
    needed = {other for service in services.values() for other in service.get("depends_on", {})}
    assert needed <= set(services)


def test_readme_opens_with_what_it_is_and_two_commands():
    first = (ROOT / "README.md").read_text().split("\n## ")[0]
    blocks = re.findall(r"```sh\n(.*?)```", first, flags=re.DOTALL)
    commands = [line.split("#")[0].strip() for block in blocks for line in block.splitlines()]
    assert commands == ["make demo", "make test"]
    assert len(first.splitlines()) <= 12
