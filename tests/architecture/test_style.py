"""Habits that a linter does not know: docstrings, length of files, and an import that would switch off shape checks."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for top in ("libs", "services") for path in (ROOT / top).rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
SCIENCE = [path for path in SOURCES if "nerfmodal" in path.relative_to(ROOT).parts]
LONGEST_FILE = 400
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
SEEDED = {"default_rng", "Generator", "SeedSequence", "PCG64", "Philox"}


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def test_every_module_says_what_it_is():
    assert [name(path) for path in SOURCES if path.read_text().strip() and not ast.get_docstring(tree(path))] == []


def test_everything_public_in_the_science_has_a_docstring():
    bare = {name(path): undocumented(tree(path)) for path in SCIENCE}
    assert {path: names for path, names in bare.items() if names} == {}


def undocumented(module: ast.Module) -> list[str]:
    """Public functions and classes at the top of a module, and public methods, without a docstring."""
    tops = [node for node in module.body if isinstance(node, DEFINITIONS) and not node.name.startswith("_")]
    members = [node for top in tops if isinstance(top, ast.ClassDef) for node in top.body]
    methods = [node for node in members if isinstance(node, DEFINITIONS) and not node.name.startswith("_")]
    return [node.name for node in tops + methods if ast.get_docstring(node) is None]


def test_every_file_is_one_idea_long():
    lengths = {name(path): len(path.read_text().splitlines()) for path in (*SOURCES, *TESTS)}
    assert {path: length for path, length in lengths.items() if length > LONGEST_FILE} == {}


def test_annotations_stay_values_so_that_shapes_are_checked():
    postponed = [name(path) for path in SCIENCE if "annotations" in imported_names(tree(path), "__future__")]
    assert postponed == []


def imported_names(module: ast.Module, origin: str) -> set[str]:
    """What a module imports from `origin`."""
    nodes = [node for node in ast.walk(module) if isinstance(node, ast.ImportFrom) and node.module == origin]
    return {alias.name for node in nodes for alias in node.names}


def test_randomness_is_an_argument():
    """No global generator: `np.random.normal` and the like depend on who called them before."""
    used = {name(path): random_calls(tree(path)) - SEEDED for path in SCIENCE}
    assert {path: names for path, names in used.items() if names} == {}


def random_calls(module: ast.Module) -> set[str]:
    """Attributes of numpy.random that a module uses."""
    attributes = [node for node in ast.walk(module) if isinstance(node, ast.Attribute)]
    return {node.attr for node in attributes if ast.unparse(node.value) in {"np.random", "numpy.random"}}


HEAVY_HOMES = {
    "bpy": {"libs/nerfmodal/simulate/blender.py"},
    "open3d": {"libs/nerfmodal/cloud/", "libs/nerfmodal/simulate/preview.py", "libs/nerfmodal/io/"},
    "torch": {"libs/nerfmodal/field/", "libs/nerfmodal/cloud/extract.py"},
}


@pytest.mark.parametrize("wheel", HEAVY_HOMES)
def test_heavy_wheels_are_imported_at_home_alone(wheel: str):
    strangers = [
        name(path)
        for path in SOURCES
        if wheel in imported(tree(path)) and not any(name(path).startswith(home) for home in HEAVY_HOMES[wheel])
    ]
    assert strangers == []


def imported(module: ast.Module) -> set[str]:
    """Top-level packages that a module imports anywhere in it."""
    nodes = list(ast.walk(module))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    origins = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and node.level == 0}
    return {full.split(".")[0] for full in plain | origins}
