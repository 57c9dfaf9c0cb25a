"""URIs of pictures that are no names of files (with NUL, a lone surrogate, half an address) ended in a traceback."""

import json

import pytest

from gltf_kit.gltf_maker import textured_triangle


@pytest.mark.parametrize(
    "uri", ["a%00.png", "\ud800.png", "http://[", ".", "x" * 5000], ids=["nul", "half", "[", ".", "long"]
)
def test_the_mesh_is_baked_and_the_uri_stays(uri, tmp_path, command):
    document = textured_triangle(images=[{"uri": uri}])
    (tmp_path / "a.gltf").write_text(json.dumps(document), encoding="utf-8")
    for output in ("out/", "b.glb"):
        words = ("-o", f"{tmp_path}/{output}", "--size", "32", "-n", "64", "--backend", "ray")
        done = command("bake", tmp_path / "a.gltf", *words)
        assert done.returncode == 0, done.stderr
    made = json.loads((tmp_path / "out" / "a_ao.gltf").read_text(encoding="utf-8"))
    assert made["images"][0]["uri"] == uri
