"""An OBJ in another folder named its textures by `../..`: trimesh does not follow that, and it breaks when moved."""

import shutil

import pytest
import trimesh
from PIL import Image

from aoprecalc import BakeOptions
from aoprecalc.api.bake import bake_file

QUADS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3 4/4\n"


def bake(mesh, output):
    output.parent.mkdir(parents=True, exist_ok=True)
    return bake_file(mesh, output, options=BakeOptions(size=16, directions=16, backend="ray"))


@pytest.fixture
def mesh(tmp_path):
    """An OBJ whose library and picture are in other folders."""
    folder = tmp_path / "in" / "meshes"
    (folder / "lib").mkdir(parents=True)
    (tmp_path / "in" / "maps").mkdir()
    Image.new("RGB", (2, 2), (1, 2, 3)).save(tmp_path / "in" / "maps" / "wood.png")
    library = r"map_Kd ..\..\MAPS\Wood.png" + "\nmap_Ks -bm 1 ../../maps/wood.png\n"
    (folder / "lib" / "a.mtl").write_text(f"newmtl wood\n{library}newmtl other\nmap_Kd ../../maps/wood.png\n")
    (folder / "a.obj").write_text(f"mtllib lib/a.mtl\n{QUADS}")
    return folder / "a.obj"


def test_the_new_folder_can_be_moved(tmp_path, mesh):
    bake(mesh, tmp_path / "out" / "a_ao.png")
    shutil.move(tmp_path / "out", tmp_path / "moved")
    shutil.rmtree(mesh.parent)
    lines = (tmp_path / "moved" / "a_ao.mtl").read_text().splitlines()
    assert lines[:4] == ["newmtl wood", "map_Kd wood.png", "map_Ks -bm 1 wood.png", "map_Ka a_ao.png"]
    made = {path.name for path in (tmp_path / "moved").iterdir()}
    assert made == {"a_ao.mtl", "a_ao.obj", "a_ao.png", "wood.png"}
    assert trimesh.load(tmp_path / "moved" / "a_ao.obj").visual.material.image.getpixel((0, 0)) == (1, 2, 3)


def test_again_and_beside_another_picture_of_the_name(tmp_path, mesh):
    for _ in range(2):
        bake(mesh, tmp_path / "out" / "a_ao.png")
    assert len(list((tmp_path / "out").iterdir())) == 4
    (tmp_path / "out" / "wood.png").write_bytes(b"another")
    bake(mesh, tmp_path / "out" / "a_ao.png")
    assert "map_Kd wood_1.png" in (tmp_path / "out" / "a_ao.mtl").read_text()
    assert (tmp_path / "out" / "wood.png").read_bytes() == b"another"


def test_in_its_own_folder_or_above_nothing_is_copied(tmp_path, mesh):
    bake(mesh, mesh.with_name("b.png"))
    assert "map_Kd ../maps/wood.png" in mesh.with_name("b.mtl").read_text()
    bake(mesh, tmp_path / "in" / "c.png")
    assert "map_Kd maps/wood.png" in (tmp_path / "in" / "c.mtl").read_text()
    assert [path.name for path in (tmp_path / "in").rglob("wood*")] == ["wood.png"]


def test_what_is_no_image_is_not_copied(tmp_path, mesh):
    (tmp_path / "in" / "maps" / "wood.png").write_text("secret")
    bake(mesh, tmp_path / "out" / "a_ao.obj")
    assert not any(b"secret" in path.read_bytes() for path in (tmp_path / "out").iterdir())


def test_a_batch_gives_each_mesh_its_own(tmp_path, mesh, command):
    shutil.copytree(tmp_path / "in", tmp_path / "other")
    Image.new("RGB", (2, 2), (9, 9, 9)).save(tmp_path / "other" / "maps" / "wood.png")
    (tmp_path / "other" / "meshes" / "a.obj").rename(tmp_path / "other" / "meshes" / "b.obj")
    words = ("--bake", "--size 16 -n 16 --backend ray", "-o", tmp_path / "out")
    done = command("batch", mesh, tmp_path / "other" / "meshes" / "b.obj", *words)
    assert done.returncode == 0, done.stderr
    colors = set()
    for made in (tmp_path / "out").rglob("*_ao.obj"):
        colors.add(trimesh.load(made).visual.material.image.getpixel((0, 0)))
    assert colors == {(1, 2, 3), (9, 9, 9)}
