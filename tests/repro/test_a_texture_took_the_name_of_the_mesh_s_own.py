"""`-o g/cow.gltf` named its texture cow.png, so that the cow.png of the mesh itself was renamed."""

import numpy as np
import pytest
from PIL import Image

import aoprecalc as ao
from aoprecalc.api.bake import bake_file
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_documents import APART, corner
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_values import GltfValues
from pipeline.helpers import write_ring
from shapes import torus

QUICK = BakeOptions(size=32, directions=64)


def test_the_picture_of_a_mesh_keeps_its_name(tmp_path):
    Image.fromarray(np.full((4, 4, 3), 99, np.uint8)).save(tmp_path / "cow.png")
    before = (tmp_path / "cow.png").read_bytes()
    maker = GltfMaker(tmp_path)
    maker.add("textures", {"source": maker.add("images", {"uri": "cow.png"})})
    material = maker.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    maker.node(mesh=maker.mesh(corner(maker, APART, material=material)))
    mesh = maker.save("cow.gltf", "cow.bin")
    (tmp_path / "g").mkdir()
    bake_file(mesh, tmp_path / "g" / "cow.gltf", options=QUICK)
    assert sorted(path.name for path in (tmp_path / "g").iterdir()) == ["cow.bin", "cow.gltf", "cow.png", "cow_ao.png"]
    assert (tmp_path / "g" / "cow.png").read_bytes() == before
    document = GltfValues(tmp_path / "g" / "cow.gltf").json
    assert {image["uri"] for image in document["images"]} == {"cow.png", "cow_ao.png"}


def test_compare_knows_the_surface_of_such_a_texture(tmp_path):
    mesh = write_ring(tmp_path / "ring.obj")
    files = bake_file(mesh, tmp_path / "car.obj", options=QUICK).files
    details = ao.compare(files.texture, files.texture).to_dict()["details"]
    assert details["surface"]["texels"] < details["picture"]["texels"]
    for path in (tmp_path / "car.obj", tmp_path / "car.mtl"):
        path.unlink()
    write_ring(tmp_path / "car.obj")  # as one that the bake had read: nothing says that the texture is its own
    assert ao.compare(files.texture, files.texture).to_dict()["details"]["surface"] is None


@pytest.mark.parametrize("name", ["car.gltf", "car.obj", "car.glb"])
def test_an_error_about_a_folder_names_what_was_given(name, tmp_path, command):
    """It named out1/car.png, which nobody had written."""
    mesh, wanted = write_ring(tmp_path / "ring.obj"), tmp_path / "out1" / name
    done = command("bake", mesh, "--size", "32", "-n", "64", "-o", wanted)
    assert done.returncode == 1
    assert done.stderr == f"error: {wanted}: there is no folder {wanted.parent}; create it or choose another output\n"
    result = ao.bake(ao.Mesh(*torus(around=16, across=8), name="ring"), QUICK)
    with pytest.raises(ao.OutputError, match=f"{name}: there is no folder"):
        result.save(wanted)
