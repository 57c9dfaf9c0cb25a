"""A glTF whose pictures are missing: "are missing from the result", but the references to them stay, as they should."""

import pytest

from aoprecalc.api.bake import bake_file
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_documents import APART, corner
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import ERROR, issues, needs_validator
from gltf_kit.gltf_values import GltfValues

MISSING = ["color%20map.png", "maps/bumps.png"]


@pytest.fixture
def model(tmp_path):
    """A glTF with references to two pictures that are not there."""
    maker = GltfMaker(tmp_path)
    for uri in MISSING:
        maker.add("textures", {"source": maker.add("images", {"uri": uri})})
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1}}
    maker.node(mesh=maker.mesh(corner(maker, APART, material=maker.add("materials", material))))
    return maker.save("model.gltf", "model.bin")


@pytest.mark.parametrize("output", ["model_ao.gltf", "made/model_ao.gltf", "made/model_ao.glb"])
def test_one_warning_names_them_and_the_document_keeps_them(model, output, tmp_path):
    (tmp_path / "made").mkdir()
    result = bake_file(model, tmp_path / output, options=BakeOptions(size=32, directions=64))
    (warning,) = [line for line in result.report.warnings if "image" in line]
    assert warning == (
        f"{model} refers to 2 images that cannot be read: 'color map.png', 'maps/bumps.png'; "
        "they were missing before the bake, and the result still refers to them"
    )
    document = GltfValues(tmp_path / output).json
    assert [image["uri"] for image in document["images"] if "uri" in image][:2] == MISSING
    (material,) = document["materials"]
    assert material["pbrMetallicRoughness"]["baseColorTexture"]["index"] == 0
    assert material["normalTexture"]["index"] == 1


@needs_validator
@pytest.mark.parametrize("output", ["model_ao.gltf", "made/model_ao.glb"])
def test_nothing_else_is_wrong_with_the_result(model, output, tmp_path):
    (tmp_path / "made").mkdir()
    bake_file(model, tmp_path / output, options=BakeOptions(size=32, directions=64))
    for found in issues(model, tmp_path / output):
        assert [issue["code"] for issue in found if issue["severity"] == ERROR] == ["IO_ERROR"] * 2
