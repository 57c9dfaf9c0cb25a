"""A texture that was baked for another mesh was drawn, and measured, where its seams tell nothing."""

import numpy as np
import pytest

from aoprecalc import BakeOptions, VerifyOptions, verify
from aoprecalc.api.bake import bake_file
from aoprecalc.api.compare import compare
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.progress import warnings_of
from shapes import box, join

FEW = VerifyOptions(points=100, rays=64)


def save(path, shape):
    positions, faces = shape
    lines = [f"v {x} {y} {z}" for x, y, z in positions] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines))
    return path


def bake(mesh, output):
    options = BakeOptions(size=64, directions=64, backend="ray", padding=2)
    return bake_file(mesh, output, options=options).files


@pytest.fixture
def baked(tmp_path):
    one = save(tmp_path / "one.obj", box())
    two = save(tmp_path / "two.obj", join(box(), box((3, 0, 0), (4, 1, 1))))
    return bake(one, tmp_path / "one_ao.png"), bake(two, tmp_path / "two_ao.png")


def test_it_is_a_warning_for_every_command(baked):
    one, two = baked
    told = f"{two.texture}: was baked for a mesh of 24 triangles, but {one.mesh} has 12 triangles"
    for warnings in (
        warnings_of(mesh_to_draw(one.mesh, two.texture).messages),
        verify(one.mesh, two.texture, FEW).warnings,
        compare(one.texture, two.texture, mesh=one.mesh).warnings,
    ):
        assert any(told in line for line in warnings), warnings


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.obj", "a.ply", "a.gltf", "a.glb"])
def test_a_texture_on_its_own_mesh_is_no_warning(tmp_path, name):
    files = bake(save(tmp_path / "one.obj", box()), tmp_path / name)
    assert not any("baked for a mesh" in line for line in verify(files.mesh, files.texture, FEW).warnings)


def test_the_few_points_that_a_floor_leaves_its_stool_are_told(tmp_path):
    floor = np.array([(-100, -100, 0), (100, -100, 0), (100, 100, 0), (-100, 100, 0)], float)
    lines = [f"v {x} {y} {z}" for x, y, z in np.concatenate([box()[0], floor])]
    faces = [f"f {a} {b} {c}" for a, b, c in box()[1] + 1]
    (tmp_path / "a.obj").write_text("\n".join([*lines, "o stool", *faces, "o the floor", "f 9 10 11 12"]))
    files = bake(tmp_path / "a.obj", tmp_path / "b.glb")
    (line,) = [line for line in verify(files.mesh, options=FEW).warnings if "larger" in line]
    assert line.endswith("lie on the other parts; measure them alone with --occluders-only 'the floor'")
    alone = VerifyOptions(points=100, rays=64, occluders_only=("the floor",))
    assert not any("larger" in line for line in verify(files.mesh, options=alone).warnings)
