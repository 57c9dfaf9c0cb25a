"""Which texture pictures of a mesh show, and what is said where there is none."""

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.errors import ArgumentError, InputError, UsageError
from aoprecalc.io import write_colors, write_image
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Note
from shapes import torus

QUICK = {"size": 32, "directions": 64, "backend": "ray", "threads": 1}
TENT = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 2 1
v 1 2 1
vt 0 0
vt 0.5 0
vt 0.5 1
vt 0 1
vt 1 0
vt 1 1
f 1/1 2/2 3/3 4/4
f 4/2 3/3 6/6 5/5
"""


@pytest.fixture
def tent(tmp_path):
    (tmp_path / "tent.obj").write_text(TENT)
    return tmp_path / "tent.obj"


@pytest.fixture
def baked(tent):
    """The result of a bake of the tent, and the files of it."""
    result = ao.bake(tent, BakeOptions(**QUICK))
    return result, result.save(tent.parent / "out.obj")


def textured_mesh(*given):
    """The mesh with its texture, without what is told about it."""
    return mesh_to_draw(*given).mesh


def same(mesh, result):
    """The mesh shows the texture of a bake, up to 8 bits."""
    assert np.abs(mesh.ao - result.ao).max() < 1 / 255
    assert np.allclose(mesh.uvs, result.mesh.uvs, atol=1e-6)
    assert np.allclose(mesh.normals, result.mesh.normals, atol=1e-6)
    assert mesh.textured.all()
    return True


def test_a_bake_is_shown_from_memory_as_from_its_files(baked):
    result, files = baked
    for shown in (result._baked, result.mesh, files.mesh, files.texture):
        assert same(textured_mesh(shown), result)
    assert mesh_to_draw(files.texture).name == "out"
    assert {files.mesh, files.texture} <= set(mesh_to_draw(files.mesh).files)


def test_any_mesh_with_uvs_shows_a_given_texture(tent):
    values = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    write_image(tent.with_name("given.png"), values)
    for texture in (values, tent.with_name("given.png")):
        found = mesh_to_draw(tent, texture)
        assert np.abs(found.mesh.ao - values).max() < 1 / 255
        assert found.mesh.textured.all()
        assert found.messages == ()


def test_the_bake_says_which_axis_points_up(tent):
    files = ao.bake(tent, BakeOptions(**QUICK, ground=True, up="z")).save(tent.parent / "out.glb")
    assert mesh_to_draw(files.mesh).up == "z"
    assert mesh_to_draw(tent).up == "y"


def test_a_mesh_without_a_texture_is_clay_and_a_note_says_how_to_bake_it(tent, tmp_path):
    found = mesh_to_draw(tent)
    assert (found.mesh.ao, found.mesh.uvs, found.texture) == (None, None, None)
    assert not found.mesh.textured.any()
    assert [type(line) for line in found.messages] == [Note]
    assert found.messages[0].endswith(f"it is drawn as clay; to bake it: aoprecalc bake {tent}")
    arrays = mesh_to_draw(ao.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="sail"))
    assert list(arrays.messages) == ["sail: has no ambient occlusion, it is drawn as clay; bake it first"]


def test_the_baked_copy_beside_a_mesh_is_pointed_at(tent):
    ao.bake(tent, BakeOptions(**QUICK)).save(f"{tent.parent}/")
    assert mesh_to_draw(tent).messages[0].endswith(f"did you mean {tent.with_name('tent_ao.obj')}?")


@pytest.mark.parametrize(("color", "shown"), [((200, 40, 40), False), ((90, 90, 90), True)])
def test_a_diffuse_texture_is_no_ambient_occlusion(tent, color, shown):
    write_colors(tent.with_name("skin.png"), np.full((4, 4, 3), color, np.uint8))
    tent.with_suffix(".mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    tent.write_text(f"mtllib tent.mtl\nusemtl skin\n{TENT}")
    assert (textured_mesh(tent).ao is not None) == shown
    assert textured_mesh(tent, tent.with_name("skin.png")).ao is not None


def test_wrong_textures_and_meshes_are_one_line(tent, tmp_path):
    bare = tmp_path / "bare.obj"
    bare.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    write_image(tmp_path / "alone.png", np.ones((2, 2), np.float32))
    for mesh, texture, kind, words in [
        (bare, tmp_path / "alone.png", InputError, "has no UVs"),
        (tent, tmp_path / "none.png", InputError, "there is no such file"),
        (tent, bare, InputError, "cannot be read as an image"),
        (tent, np.full((2, 2), 7.0), ArgumentError, "has values from 7"),
        (tmp_path / "alone.png", None, UsageError, "no mesh is beside it"),
        (tmp_path / "none.png", None, InputError, "there is no such file"),
    ]:
        with pytest.raises(kind, match=words) as error:
            textured_mesh(mesh, texture)
        assert "\n" not in str(error.value)


def ring_with_seams():
    """A torus whose faces are scattered over the texture: all its edges are seams."""
    positions, faces = torus(around=24, across=12)
    side = int(np.ceil(np.sqrt(len(faces))))
    corner = np.stack(np.divmod(np.random.default_rng(0).permutation(side**2)[: len(faces)], side), 1) / side
    uvs = corner[:, None] + np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]]) / side
    return ao.Mesh(positions, faces, uvs=uvs, name="ring"), side


def picture_of(mesh, side, values, upside_down=False):
    """A texture of the values at the middles of faces; their texels lie in a grid."""
    picture = np.zeros((side, side), np.float32)
    cells = np.floor(mesh.uvs[:, 0] * side).astype(int)
    picture[side - 1 - cells[:, 1], cells[:, 0]] = values
    picture = picture.repeat(8, axis=0).repeat(8, axis=1)
    return picture[::-1] if upside_down else picture


def test_a_texture_of_another_mesh_is_refused():
    mesh, side = ring_with_seams()
    height = (mesh.vertices[mesh.faces].mean(axis=1)[:, 2] / 0.8 + 0.5).clip(0, 1)
    assert textured_mesh(mesh, picture_of(mesh, side, height)).ao is not None
    shuffled = np.random.default_rng(1).permutation(height)
    with pytest.raises(InputError, match=r"does not belong to ring: .* pass the texture of this mesh"):
        textured_mesh(mesh, picture_of(mesh, side, shuffled))
    with pytest.raises(InputError, match="it fits upside down: flip it"):
        textured_mesh(mesh, picture_of(mesh, side, height, upside_down=True))
    grey = np.full_like(height, 0.5) + np.random.default_rng(1).random(len(height)) * 0.01
    assert textured_mesh(mesh, picture_of(mesh, side, grey)).ao is not None  # nothing can be told
