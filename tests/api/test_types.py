"""The public names: what there is, that importing them costs nothing, and that type checkers see their types."""

import ast
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import aoprecalc as ao

ROOT = Path(ao.__file__).parents[2]

SCRIPT = """


import numpy as np
import trimesh

import aoprecalc as ao

mesh = ao.Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]), normals=np.ones((3, 3)), uvs=[[0, 0], [1, 0], [0, 1]])
loaded = ao.load("car.glb")
converted = ao.Mesh.from_trimesh(trimesh.Trimesh())
options = ao.BakeOptions(size=(1024, 512), directions=500)
for source in (mesh, "car.glb", trimesh.Trimesh()):
    result = ao.bake(source, options)
    files = result.save("build/")
    texture = result.ao
    uvs, normals = result.mesh.uvs, result.mesh.normals
    count = result.mesh.uvs.shape[0] + result.mesh.ao.size
    error, mean, warnings = result.report.error, result.report.ao.mean, result.report.warnings
    parts, verified = result.report.parts, result.report.verify
spheres = ao.fit_spheres(mesh, ao.SphereOptions(64, method="shadow"))
quality = ao.measure_spheres(mesh, spheres.centers, spheres.radii)
picture = ao.preview("car.glb", ao.PreviewOptions(views=4), texture=np.ones((4, 4)), spheres=spheres)
for given in (spheres.spheres, "a.json", (spheres.centers, spheres.radii)):
    ao.preview(mesh, spheres=given)
shown, drawn = result.preview(ao.PreviewOptions(size=512)), spheres.preview()
report = ao.verify(mesh, np.ones((4, 4)), ao.VerifyOptions(points=100))
compared = ao.compare("a.png", "b.png", ao.CompareOptions(tolerance=0.01))
checked = ao.doctor()
batch = ao.batch("assets", "build/")
try:
    ao.load("missing.obj")
except ao.InputError as failure:
    code = failure.exit_code
"""
VALUES = """
    mesh mesh.vertices mesh.faces mesh.normals mesh.uvs mesh.ao mesh.name mesh.to_trimesh() loaded converted options
    options.directions result texture uvs normals error mean warnings parts verified files files.texture result.valid
    spheres spheres.centers spheres.radii spheres.quality spheres.quality.leak spheres.save("a.json") spheres.spheres
    picture picture.pictures picture.image picture.report.shading picture.save() shown drawn ao.preview
    quality quality.silhouette_iou report report.error report.levels report.worst report.passed
    compared compared.answer compared.difference checked checked.renderers checked.passed code
    batch batch.report.counts.made batch.report.seconds
    ao.load_spheres("a.csv") ao.bake ao.load ao.fit_spheres ao.measure_spheres ao.verify ao.compare ao.doctor
"""
REVEALED = VALUES.split()
NUMPYS_OWN = r"tuple\[Any, \.\.\.\]|numpy\.dtype\[Any\]"  # the shapes of its arrays, and its ArrayLike


def test_importing_the_package_imports_nothing_heavy():
    program = "import sys, aoprecalc; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not {"numpy", "scipy", "trimesh", "moderngl", "msgspec"} & set(done.stdout.split())


def test_every_public_name_is_there_and_seen_by_type_checkers():
    tree = ast.parse(Path(ao.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {alias.name for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert sorted(typed | {"__version__"}) == ao.__all__ == dir(ao)
    for name in ao.__all__:
        assert getattr(ao, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Scene'"):
        ao.Scene  # noqa: B018 - the look-up is what raises


@pytest.mark.parametrize("name", [name for name in ao.__all__ if name != "__version__"])
def test_every_public_function_is_documented_for_numpydoc(name):
    value = getattr(ao, name)
    text = inspect.getdoc(value)
    assert text.splitlines()[0].endswith(".")
    if not inspect.isclass(value):
        assert re.search(r"^Returns\n-------$", text, re.MULTILINE)
        for argument in inspect.signature(value).parameters:
            assert re.search(rf"^(\w+, )*{argument}(, \w+)* : ", text, re.MULTILINE), argument


@pytest.mark.slow
def test_mypy_sees_the_types_of_a_users_script(tmp_path):
    pytest.importorskip("mypy")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT + "".join(f"reveal_type({name})\n" for name in REVEALED))
    checks = ["--strict", "--config-file", ROOT / "pyproject.toml"]
    command = [sys.executable, "-m", "mypy", *checks, script]
    environment = {**os.environ, "MYPYPATH": str(ROOT / "src")}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment)
    revealed = re.findall(r'Revealed type is "(.*)"$', done.stdout, re.MULTILINE)
    assert len(revealed) == len(REVEALED), done.stdout
    assert "error:" not in done.stdout
    for name, kind in zip(REVEALED, revealed, strict=True):
        assert not re.search(r"\bAny\b", re.sub(NUMPYS_OWN, "", kind)), f"{name}: {kind}"
