"""URIs of pictures that are no names of files (with NUL, a lone surrogate, half an address) ended in a traceback."""

import json

import numpy as np
import pytest

from gltf_kit.gltf_maker import data_uri

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


@pytest.mark.parametrize(
    "uri", ["a%00.png", "\ud800.png", "http://[", ".", "x" * 5000], ids=["nul", "half", "[", ".", "long"]
)
def test_the_mesh_is_baked_and_the_uri_stays(uri, tmp_path, command):
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": uri}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": data_uri(TRIANGLE, "application/octet-stream")}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document), encoding="utf-8")
    for output in ("out/", "b.glb"):
        words = ("-o", f"{tmp_path}/{output}", "--size", "32", "-n", "64", "--backend", "ray")
        done = command("bake", tmp_path / "a.gltf", *words)
        assert done.returncode == 0, done.stderr
    made = json.loads((tmp_path / "out" / "a_ao.gltf").read_text(encoding="utf-8"))
    assert made["images"][0]["uri"] == uri
