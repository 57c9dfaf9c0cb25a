"""verify took the colour picture of an OBJ for its ambient occlusion, where preview refused it."""

import numpy as np
import pytest

from aoprecalc import VerifyOptions, verify
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.io import find_occlusion, load_scene, write_image
from aoprecalc.io.images import write_colors
from aoprecalc.io.occlusion import NoOcclusionError

FACE = "vt 0 0\nvt 1 0\nvt 1 1\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nmtllib a.mtl\n"
COLORS = np.full((4, 4, 3), (200, 90, 30), np.uint8)
FEW = VerifyOptions(points=100, rays=64)


@pytest.fixture
def colored(tmp_path):
    (tmp_path / "a.obj").write_text(f"{FACE}usemtl wood\nf 1/1 2/2 3/3\n")
    (tmp_path / "a.mtl").write_text("newmtl wood\nmap_Kd wood.png\n")
    write_colors(tmp_path / "wood.png", COLORS)
    return tmp_path / "a.obj"


def test_a_picture_with_colours_is_no_occlusion_for_any_command(colored):
    with pytest.raises(NoOcclusionError, match=r"wood\.png: has colours, .*; bake .*a\.obj, or pass its texture"):
        verify(colored, options=FEW)
    found = mesh_to_draw(colored)
    assert found.texture is None
    assert any("has no ambient occlusion" in line for line in found.messages)


def test_neither_is_one_beside_the_mesh(tmp_path):
    (tmp_path / "a.obj").write_text(f"{FACE}f 1/1 2/2 3/3\n")
    write_colors(tmp_path / "a.png", COLORS)
    with pytest.raises(NoOcclusionError, match="has colours"):
        find_occlusion(load_scene(tmp_path / "a.obj"))
    write_image(tmp_path / "a.png", np.full((4, 4), 0.5, np.float32))
    assert find_occlusion(load_scene(tmp_path / "a.obj")).values == pytest.approx(0.5, abs=0.01)


def test_a_picture_that_is_named_is_measured(colored):
    assert verify(colored, colored.with_name("wood.png"), FEW).points == 100


def test_of_several_materials_the_one_without_colours_is_measured(colored):
    (colored.parent / "a.mtl").write_text("newmtl wood\nmap_Kd wood.png\nnewmtl baked\nmap_Kd b.png\n")
    write_image(colored.with_name("b.png"), np.full((4, 4), 0.5, np.float32))
    with colored.open("a") as file:
        file.write("usemtl baked\nf 4/1 5/2 6/3\n")
    found = find_occlusion(load_scene(colored))
    assert found.path == colored.with_name("b.png")
    assert found.shown.tolist() == [False, True]
    assert mesh_to_draw(colored).mesh.textured.tolist() == [False, True]
