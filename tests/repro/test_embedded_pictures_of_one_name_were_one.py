"""Two pictures that a file embeds under one name, or none, were taken for the same."""

import io

import pytest
from PIL import Image

from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors
from fbx_text import FbxText

pytest.importorskip("ufbx")


def png(color):
    data = io.BytesIO()
    Image.new("RGB", (2, 2), color).save(data, "PNG")
    return data.getvalue()


@pytest.mark.parametrize("name", ["wood.png", ""])
def test_each_material_has_its_own(tmp_path, name):
    scene, colors = FbxText(), [(255, 0, 0), (0, 0, 255)]
    for number, color in enumerate(colors):
        material = scene.material(f"m{number}")
        scene.texture(name, material, data=png(color))
        corners = [(number, 0, 0), (number + 1, 0, 0), (number, 1, 0)]
        mesh = scene.mesh(corners, [[0, 1, 2]], uv_sets=[("map", [(0, 0), (1, 0), (0, 1)])], materials=[0])
        scene.node(f"n{number}", mesh, materials=(material,))
    (tmp_path / "a.fbx").write_text(str(scene))
    found, warnings = base_colors(load_scene(tmp_path / "a.fbx"))
    assert [color.texture[0, 0].tolist() for color in found] == [list(color) for color in colors]
    assert warnings == ()
