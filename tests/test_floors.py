"""The package's floors: imports run downward only."""

import ast
from pathlib import Path

import pytest

import aoprecalc

ROOT = Path(aoprecalc.__file__).parent

# From the top. What stands on a floor may import what lies below it, and nothing beside or above it.
FLOORS = [
    ["cli"],
    ["pipeline"],
    ["api"],
    ["io", "render"],
    ["spheres", "metrics"],
    ["uv", "visibility"],
    ["raster"],
    ["gl", "mesh"],
    ["texture_lookup"],
    ["types"],
    ["options", "progress", "quantities", "subprocesses", "system"],
    ["errors"],
]
LEVEL = {name: level for level, names in enumerate(FLOORS) for name in names}
STANDARD_LIBRARY_ONLY = ["options", "errors", "progress", "quantities", "subprocesses", "system", "__init__"]
NO_GL = ["spheres", "metrics", "io", "render", "mesh", "types"]
MODULES = sorted(path.relative_to(ROOT) for path in ROOT.rglob("*.py"))


def imports(path):
    """Every module that a file imports, also inside functions."""
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield node.module


def part(module):
    """The folder or module of the package that a dotted name or path leads to."""
    return module.parts[0].removesuffix(".py") if isinstance(module, Path) else (module.split(".") + [""])[1]


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_imports_run_downward(path):
    here = part(path)
    if here in ("__init__", "__main__"):
        return
    for module in imports(path):
        if module.startswith("aoprecalc."):
            there = part(module)
            assert there == here or LEVEL[there] > LEVEL[here], f"{path} ({here}) imports {module}"


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_light_modules_stay_light(path):
    outside = {module.split(".")[0] for module in imports(path)} - {"aoprecalc"}
    if part(path) in STANDARD_LIBRARY_ONLY:
        import sys

        assert outside <= set(sys.stdlib_module_names)
    if part(path) in NO_GL:
        assert "moderngl" not in outside
    if part(path) not in ("cli",):
        assert not outside & {"click", "rich"}


def test_every_folder_has_a_floor():
    assert {part(path) for path in MODULES} - {"__init__", "__main__"} == set(LEVEL)
