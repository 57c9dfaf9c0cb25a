"""An OBJ whose materials had pictures, but its faces no UVs, became a GLB "with both" that had none of the pictures."""

from aoprecalc import BakeOptions
from aoprecalc.api.bake import bake_file

TRIANGLES = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nusemtl wood\n"


def test_it_stays_an_obj_and_one_line_names_the_pictures(tmp_path):
    (tmp_path / "a.obj").write_text(f"{TRIANGLES}f 1 2 3\nf 3 2 4\n")
    (tmp_path / "a.mtl").write_text("newmtl wood\nKd 1 0 0\nmap_Kd wood.png\nmap_Bump -bm 2 bump.png\n")
    folder = tmp_path / "out"
    folder.mkdir()
    baked = bake_file(tmp_path / "a.obj", folder, options=BakeOptions(size=32, directions=64))
    assert baked.files.mesh == folder / "a_ao.obj"
    assert (folder / "a_ao.mtl").read_text() == "newmtl wood\nKd 1 0 0\nmap_Kd a_ao.png\n"
    told = [line for line in (*baked.report.warnings, *baked.report.notes) if "wood" in line]
    no_uvs = "the mesh had no UVs for the textures of its materials, which are left out"
    assert told == [f"{folder / 'a_ao.mtl'}: {no_uvs}: 'wood.png', 'bump.png'"]
