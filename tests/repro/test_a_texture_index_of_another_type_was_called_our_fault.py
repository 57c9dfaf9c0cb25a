"""A texture's index such as 0.5 or "0", with `--pack orm`: "a fault of aoprecalc". It is damage of the file."""

import numpy as np
import pytest

from gltf_kit.gltf_documents import APART, corner
from gltf_kit.gltf_maker import GltfMaker

QUICK = ["--size", "32", "-n", "64", "--backend", "ray", "--pack", "orm"]


def model(folder, index, **extensions):
    maker = GltfMaker(folder)
    maker.texture(np.full((8, 8, 3), 99, np.uint8))
    info = {"index": index, "texCoord": 0}
    material = {"pbrMetallicRoughness": {"metallicRoughnessTexture": info}, "extensions": extensions}
    maker.node(mesh=maker.mesh(corner(maker, APART, material=maker.add("materials", material))))
    return maker.save("model.glb")


@pytest.mark.parametrize("index", [0.5, 0.0, "0", True, None], ids=repr)
def test_the_file_is_refused_as_damaged(index, tmp_path, command):
    done = command("bake", model(tmp_path, index), *QUICK, "-o", tmp_path / "a.glb")
    assert done.returncode == 4
    assert f"it refers to entry '{index}' of textures, a whole number was expected" in done.stderr
    assert "damaged" in done.stderr


def test_what_an_unknown_extension_means_is_its_own_affair(tmp_path, command):
    mesh = model(tmp_path, 0, VENDOR_paint={"someTexture": {"index": "red"}})
    done = command("bake", mesh, *QUICK, "-o", tmp_path / "a.glb")
    assert done.returncode == 0, done.stderr
