"""Random glTF documents, written with new UVs or their own: every corner of every triangle keeps what it had."""

import numpy as np
import pytest

from aoprecalc.io import load_scene
from gltf_kit.baked_by_hand import write_with_texture
from gltf_kit.gltf_compare import differences
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_occlusion import occlusion_faults
from gltf_kit.gltf_random import compress, random_document
from gltf_kit.gltf_validator import ERROR, issues, needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues

SEEDS = [pytest.param(seed, marks=[] if seed < 12 else [pytest.mark.slow]) for seed in range(150)]
HOW = ["new UVs", "new UVs and normals", "kept UVs"]


def made(seed, folder):
    folder.mkdir(exist_ok=True)
    maker = GltfMaker(folder)
    random_document(maker, seed)
    return maker.save("made.glb")


def written(seed, how, folder, name):
    """(path of the document, path of what was written of it); None where its UVs cannot be kept."""
    source = made(seed, folder)
    scene = load_scene(source)
    if how == "kept UVs" and scene.uvs is None:
        return source, None
    normals = None if "normals" in how else scene.normals.astype(np.float32)
    method = "keep" if how == "kept UVs" else "xatlas"
    return source, write_with_texture(scene, folder / "out" / name, method, normals)[0]


@needs_validator
def test_the_documents_are_valid(tmp_path):
    files = [made(seed, tmp_path / str(seed)) for seed in range(12)]
    assert [issue for found in issues(*files) for issue in found if issue["severity"] == ERROR] == []


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("seed", SEEDS)
def test_every_corner_keeps_what_it_had(seed, how, tmp_path):
    source, path = written(seed, how, tmp_path, "a.gltf" if seed % 2 else "a.glb")
    if path is None:
        pytest.skip("the document has no UVs to keep")
    before, after = GltfValues(source), GltfValues(path)
    assert differences(before, after, new_normals="normals" in how) == []
    receiving = {(part.source.node, part.source.primitive) for part in load_scene(source).parts if part.receives}
    assert occlusion_faults(before, after, (path.parent / "x_ao.png").read_bytes(), receiving) == []


@needs_validator
@pytest.mark.slow
@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("seed", range(40))
def test_what_is_written_is_as_valid(seed, how, tmp_path):
    source, path = written(seed, how, tmp_path, "a.glb" if seed % 2 else "a.gltf")
    assert path is None or new_issues(source, path) == []


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[] if seed < 3 else [pytest.mark.slow]) for seed in range(20)]
)
def test_compressed_documents_are_written_as_the_plain_ones(seed, extension, tmp_path):
    library = pytest.importorskip("meshoptimizer")
    plain = made(seed, tmp_path / "plain")
    maker = GltfMaker(tmp_path)
    random_document(maker, seed)
    compress(maker, library, extension)
    scene = load_scene(maker.save())
    assert any("compressed" in note for note in scene.notes)
    path = write_with_texture(scene, tmp_path / "out" / "a.glb", normals=scene.normals.astype(np.float32))[0]
    assert differences(GltfValues(plain), GltfValues(path)) == []
