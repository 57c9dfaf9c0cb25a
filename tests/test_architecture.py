"""The package keeps to the map in CONTRIBUTING.md: imports run down the map, never up, across or in a circle."""

import ast
import re
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import aoprecalc

ROOT = Path(aoprecalc.__file__).parent
GUIDE = Path(__file__).parents[1] / "CONTRIBUTING.md"

STANDARD_LIBRARY_ONLY = {"errors", "notebook", "options", "progress", "subprocesses", "system", "__init__"}
NO_GL = {"spheres", "metrics", "io", "render", "mesh", "types"}
MAX_LINES, MIN_MEAN_LINES = 400, 200
MIN_LINES, MAX_SLIVERS = 80, 3  # `__main__`, and two small features


def dotted_name(path):
    """The name by which a file of the package is imported."""
    parts = ("aoprecalc", *path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {dotted_name(path): path for path in sorted(ROOT.rglob("*.py"))}
FACE = {"aoprecalc", "aoprecalc.__main__"}  # what users import and start: both may use everything


def read_map(text):
    """The rows of the map, from the top: each the names of the folders and modules in its first column."""
    table = text.split("<!-- map -->")[1].split("<!-- end of map -->")[0]
    first_column = re.findall(r"^\|([^|]*)\|", table, re.MULTILINE)
    return [re.findall(r"`(\w+)[/.]", cell) for cell in first_column if "`" in cell]


LEVEL = {name: level for level, names in enumerate(read_map(GUIDE.read_text(encoding="utf-8"))) for name in names}


def imports(source):
    """The dotted name of everything that a module imports, wherever the statement stands in it.

    `from a import b` is a.b, whether b is a module or a name in one.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{'.' * node.level}{node.module or ''}.{alias.name}" for alias in node.names)


def named(source):
    """The modules of ours that strings in a module name: children are started so, and modules loaded late."""
    texts = {node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)}
    return FILES.keys() & texts - {"aoprecalc"}


def module_of(name):
    """The module of ours that an imported dotted name is, or stands in."""
    while name not in FILES:
        name = name.rpartition(".")[0]
    return name


def part(module):
    """The folder or module right under the package that a module belongs to."""
    return (module.split(".") + ["__init__"])[1]


def faults(module, source):
    """What is wrong with a module's imports, a line each."""
    for name in [*imports(source), *named(source)]:
        if name.startswith("."):
            yield f"{module} imports {name} relatively"
        elif name.split(".")[0] == "aoprecalc" and name != "aoprecalc.__version__" and module not in FACE:
            target = module_of(name)
            if target == "aoprecalc":
                yield f"{module} takes {name} from the package's public face; import it from where it is defined"
            elif part(target) != part(module) and LEVEL[part(target)] <= LEVEL[part(module)]:
                yield f"{module} imports {name}, which is not below it on the map in {GUIDE.name}"


@pytest.mark.parametrize("module", FILES)
def test_imports_run_down_the_map(module):
    assert list(faults(module, FILES[module].read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("module", "line", "fault"),
    [
        ("aoprecalc.mesh.roles", "from aoprecalc.api import bake", "not below"),
        ("aoprecalc.mesh.roles", "import aoprecalc.io.images as images", "not below"),
        ("aoprecalc.mesh.roles", "def late():\n    from aoprecalc.uv.unwrap import unwrap", "not below"),
        ("aoprecalc.mesh.roles", "run('aoprecalc.api.checks')", "not below"),
        ("aoprecalc.types", "from aoprecalc import io", "not below"),
        ("aoprecalc.metrics.errors", "from aoprecalc.spheres import fit", "not below"),
        ("aoprecalc.types", "from aoprecalc import bake", "public face"),
        ("aoprecalc.types", "import aoprecalc", "public face"),
        ("aoprecalc.types", "from .errors import UsageError", "relatively"),
        ("aoprecalc.types", "from aoprecalc import __version__, errors", None),
        ("aoprecalc.cli.main", "from aoprecalc.api.bake import bake\nimport aoprecalc.types", None),
    ],
)
def test_no_spelling_of_an_import_is_missed(module, line, fault):
    found = list(faults(module, line))
    assert (len(found) == 1 and fault in found[0]) if fault else found == []


def test_no_modules_import_each_other_in_a_circle():
    graph = {
        module: {module_of(name) for name in imports(path.read_text(encoding="utf-8")) if name.startswith("aoprecalc.")}
        - {"aoprecalc", module}
        for module, path in FILES.items()
        if module not in FACE
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(reversed(error.args[1])))


@pytest.mark.parametrize("module", FILES)
def test_light_modules_stay_light(module):
    outside = {name.split(".")[0] for name in imports(FILES[module].read_text(encoding="utf-8"))} - {"aoprecalc"}
    if part(module) in STANDARD_LIBRARY_ONLY:
        assert outside <= set(sys.stdlib_module_names)
    if part(module) in NO_GL:
        assert "moderngl" not in outside
    if part(module) != "cli":
        assert not outside & {"click", "rich"}


def test_the_map_has_every_folder_and_no_other():
    assert {part(module) for module in FILES} - {"__init__", "__main__"} == set(LEVEL)


def test_the_guide_names_files_that_are_there():
    text = GUIDE.read_text(encoding="utf-8")
    paths = set(re.findall(r"`((?:\w+/)+\w+\.py)`", text))
    assert len(paths) > 30
    assert [path for path in paths if not ((ROOT / path).exists() or (GUIDE.parent / path).exists())] == []


def test_a_feature_is_found_in_one_or_two_files():
    lines = {module: len(path.read_text(encoding="utf-8").splitlines()) for module, path in FILES.items()}
    assert {module: count for module, count in lines.items() if count > MAX_LINES} == {}, (
        "a reader should find a feature in one or two files, and read each in one sitting: "
        f"part what is above {MAX_LINES} lines at a seam"
    )
    modules = [lines[module] for module, path in FILES.items() if path.name != "__init__.py"]
    assert sum(modules) >= MIN_MEAN_LINES * len(modules), (
        "a reader should find a feature in one or two files: put what is new beside what uses it, "
        f"and join modules until they have {MIN_MEAN_LINES} lines on average"
    )
    assert sum(count < MIN_LINES for count in modules) <= MAX_SLIVERS, (
        f"modules of less than {MIN_LINES} lines belong to what uses them"
    )
