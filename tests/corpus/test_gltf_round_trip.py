"""Real glTF files beside what a bake makes of them: valid, and nothing else is changed."""

import json
import shutil

import pytest
from PIL import Image

from aoprecalc.api.bake import bake_file
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_compare import differences
from gltf_kit.gltf_occlusion import occlusion_faults, receivers
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues
from shapes import MESHES

pytestmark = [pytest.mark.corpus, pytest.mark.slow]


@pytest.fixture(scope="module", params=["ToyCar", "DamagedHelmet"])
def trip(request, tmp_path_factory):
    """(path of a document, its FileBake); pictures that shared/meshes is without have stand-ins, no two alike."""
    folder = tmp_path_factory.mktemp("trip")
    path = folder / f"{request.param}.gltf"
    for file in (MESHES / request.param).iterdir():
        shutil.copyfile(file, folder / file.name)
    for number, image in enumerate(json.loads(path.read_text())["images"]):
        if not (folder / image["uri"]).exists():
            Image.new("RGB", (8, 8), (20 * number, 100, 200)).save(folder / image["uri"])
    (folder / "out").mkdir()
    return path, bake_file(path, folder / "out", options=BakeOptions(size=512, directions=32))


@needs_validator
def test_it_is_as_valid_as_it_was(trip):
    path, result = trip
    assert new_issues(path, result.files.mesh) == []


def test_all_else_is_as_it_was(trip):
    path, result = trip
    before, after = GltfValues(path), GltfValues(result.files.mesh)
    assert differences(before, after) == []
    assert occlusion_faults(before, after, result.files.texture.read_bytes(), receivers(result.baked)) == []
