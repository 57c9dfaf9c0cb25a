"""`-o a_ao.png`, then `-o b_ao.png`: the second bake wrote its mesh over that of the first."""

from aoprecalc.api.bake import bake_file
from aoprecalc.io import load_scene
from aoprecalc.io.occlusion import find_occlusion
from aoprecalc.options import BakeOptions
from pipeline.helpers import write_ring


def test_each_texture_has_a_mesh_of_its_own(tmp_path):
    mesh = write_ring(tmp_path / "ring.obj")
    first = bake_file(mesh, tmp_path / "a_ao.png", options=BakeOptions(size=64, directions=64))
    before = (tmp_path / "a_ao.obj").read_bytes(), (tmp_path / "a_ao.mtl").read_bytes()
    second = bake_file(mesh, tmp_path / "b_ao.png", options=BakeOptions(size=32, directions=64))
    assert [result.files.mesh.name for result in (first, second)] == ["a_ao.obj", "b_ao.obj"]
    assert ((tmp_path / "a_ao.obj").read_bytes(), (tmp_path / "a_ao.mtl").read_bytes()) == before
    for name, size in (("a_ao", 64), ("b_ao", 32)):
        texture = find_occlusion(load_scene(tmp_path / f"{name}.obj"))
        assert texture.path == tmp_path / f"{name}.png"
        assert texture.values.shape == (size, size)
