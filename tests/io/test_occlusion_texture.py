"""Which picture of ambient occlusion belongs to a mesh, and how it lies on it."""

import base64
import json

import numpy as np
import pytest

from aoprecalc.api.textured_surface import TexturedSurface, mesh_to_draw
from aoprecalc.errors import InputError
from aoprecalc.io import find_occlusion, load_scene, read_image, source_files, write_image
from aoprecalc.io.images import decode_pixels
from aoprecalc.options import VerifyOptions

LIGHT = np.linspace(0.2, 0.8, 16, dtype=np.float32).reshape(2, 8)
DARK = LIGHT / 2


@pytest.fixture
def pictures(tmp_path):
    for name, values in (("light.png", LIGHT), ("dark.png", DARK)):
        write_image(tmp_path / name, values)
    return tmp_path


def shows(found, values):
    return found.values.shape == values.shape and np.abs(found.values - values).max() < 1 / 255


def add_material(maker, image, **use):
    """A material whose occlusion texture is a new image; returns its number."""
    json = maker.json
    for kind in ("images", "textures", "materials"):
        json.setdefault(kind, [])
    json["images"].append(image)
    json["textures"].append({"source": len(json["images"]) - 1})
    json["materials"].append({"occlusionTexture": {"index": len(json["textures"]) - 1, **use}})
    return len(json["materials"]) - 1


def embedded(maker, path):
    return {"bufferView": maker.view(path.read_bytes()), "mimeType": "image/png"}


def second_set(maker, primitive, values=None):
    """Give the cube a TEXCOORD_1 that differs from TEXCOORD_0; returns its 24 UVs, v downwards."""
    values = np.random.default_rng(0).random((24, 2)).astype("<f4") if values is None else values
    primitive["attributes"]["TEXCOORD_1"] = maker.accessor(values)
    return values


@pytest.mark.parametrize("way", ["embedded", "data URI", "file"])
def test_gltf_has_it_as_occlusion_texture(gltf_cube, pictures, way):
    maker, primitive = gltf_cube
    data = base64.b64encode((pictures / "light.png").read_bytes()).decode()
    image = {"file": {"uri": "light.png"}, "data URI": {"uri": f"data:image/png;base64,{data}"}}.get(way)
    primitive["material"] = add_material(maker, image or embedded(maker, pictures / "light.png"))
    maker.node(mesh=maker.mesh(primitive))
    scene = maker.load("cube.gltf" if way == "file" else "cube.glb")
    found = find_occlusion(scene)
    assert shows(found, LIGHT)
    assert np.allclose(found.uvs, scene.uvs)
    assert found.shown.all()
    assert found.path == (pictures / "light.png" if way == "file" else None)
    assert found.warnings == ()


def test_gltf_says_which_uvs_it_is_for(gltf_cube, pictures):
    maker, primitive = gltf_cube
    second = second_set(maker, primitive)
    primitive["material"] = add_material(maker, embedded(maker, pictures / "light.png"), texCoord=1)
    mesh = maker.mesh(primitive)
    maker.node(mesh=mesh)
    maker.node(mesh=mesh, scale=[-1, 1, 1], translation=[9, 0, 0])  # mirrored, so its corners are in another order
    scene = maker.load()
    vertices = np.concatenate([part.vertices for part in scene.parts])
    expected = second[vertices] * (1, -1) + (0, 1)
    assert np.allclose(find_occlusion(scene).uvs, expected)
    given = find_occlusion(scene, pictures / "dark.png")  # of another picture the UVs are the same
    assert shows(given, DARK)
    assert np.allclose(given.uvs, expected)
    assert given.shown.all()


def test_a_texture_transform_is_applied(gltf_cube, pictures):
    """The extension's own example: the lower left quarter of the picture, turned clockwise by 90 degrees."""
    maker, primitive = gltf_cube
    corners = np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (6, 1)).astype("<f4")
    second_set(maker, primitive, corners)
    transform = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5], "texCoord": 1}
    extensions = {"KHR_texture_transform": transform}
    primitive["material"] = add_material(maker, embedded(maker, pictures / "light.png"), extensions=extensions)
    maker.node(mesh=maker.mesh(primitive))
    scene = maker.load()
    lower_left = np.array([[0, 0], [0, 0.5], [0.5, 0.5], [0.5, 0]])  # v upwards
    assert np.allclose(find_occlusion(scene).uvs, lower_left[scene.parts[0].vertices % 4], atol=1e-7)


@pytest.mark.parametrize(("stated", "taken"), [(0.5, 0.5), (0, 0), (2, 1), (-1, 1)])
def test_a_strength_is_read_beside_the_values(gltf_cube, pictures, stated, taken):
    maker, primitive = gltf_cube
    primitive["material"] = add_material(maker, embedded(maker, pictures / "light.png"), strength=stated)
    maker.node(mesh=maker.mesh(primitive))
    found = find_occlusion(maker.load())
    assert shows(found, LIGHT)
    assert (found.strengths == taken).all()
    assert found.warnings == ()


def test_of_different_pictures_one_is_taken_and_the_other_faces_are_left_out(gltf_cube, pictures):
    maker, primitive = gltf_cube
    materials = [add_material(maker, {"uri": name}) for name in ("light.png", "dark.png")]
    primitives = [primitive | {"material": number} for number in materials] + [dict(primitive)]
    maker.node(mesh=maker.mesh(*primitives))
    scene = maker.load("three.gltf")
    first, second = find_occlusion(scene), find_occlusion(scene, pictures / "dark.png")
    assert shows(first, LIGHT)
    assert first.shown.tolist() == [True] * 12 + [False] * 24
    assert shows(second, DARK)
    assert second.shown.tolist() == [False] * 12 + [True] * 12 + [False] * 12
    assert (first.others, second.others) == ((str(pictures / "dark.png"),), (str(pictures / "light.png"),))
    said = [TexturedSurface.of(scene, found, VerifyOptions()).warnings for found in (first, second)]
    assert [len(lines) for lines in said] == [1, 1]
    assert said[0][0].startswith("24 of 36 faces are left out: their materials have other textures (")
    one = VerifyOptions(only=(scene.parts[0].name,))
    assert TexturedSurface.of(scene, first, one).warnings == ()  # the other parts are not to have it


def test_a_part_without_that_set_of_uvs_has_none(gltf_cube, pictures):
    maker, primitive = gltf_cube
    primitive["material"] = add_material(maker, embedded(maker, pictures / "light.png"), texCoord=3)
    maker.node(mesh=maker.mesh(primitive))
    with pytest.raises(InputError, match="has no UVs"):
        find_occlusion(maker.load())


@pytest.mark.parametrize(
    "damage",
    [{"textures": [{}]}, {"textures": []}, {"images": [{}]}, {"materials": [{"occlusionTexture": {"texCoord": 0}}]}],
    ids=lambda damage: json.dumps(damage),
)
def test_damaged_materials_are_one_line(gltf_cube, pictures, damage):
    maker, primitive = gltf_cube
    primitive["material"] = add_material(maker, {"uri": "light.png"})
    maker.node(mesh=maker.mesh(primitive))
    maker.json |= damage
    with pytest.raises(InputError, match=r"made\.glb.*damaged"):
        find_occlusion(maker.load())


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"


@pytest.mark.parametrize(
    ("lines", "expected"),
    [("map_Kd light.png", LIGHT), ("map_Kd dark.png\nmap_Ka -s 1 1 1 light.png", LIGHT), ("map_ka dark.png", DARK)],
)
def test_obj_has_it_in_its_materials(save, pictures, lines, expected):
    save("made.mtl", f"newmtl paint\n{lines}\n")
    scene = load_scene(save("made.obj", f"mtllib made.mtl\n{TRIANGLE}usemtl paint\nf 1/1 2/2 3/3\n"))
    found = find_occlusion(scene)
    assert shows(found, expected)
    assert found.uvs.tolist() == [[[0, 0], [1, 0], [0, 1]]]
    assert found.path in source_files(scene)


def test_ply_names_it_in_a_comment(save, pictures):
    header = "ply\nformat ascii 1.0\ncomment made by hand\ncomment TextureFile  dark.png\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    scene = load_scene(save("made.ply", header + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"))
    assert shows(find_occlusion(scene), DARK)
    assert source_files(scene) == [scene.path, pictures / "dark.png"]


def test_without_a_word_about_it_the_picture_of_the_same_name_is_taken(save, pictures):
    scene = load_scene(save("light.obj", f"{TRIANGLE}f 1/1 2/2 3/3\n"))
    assert shows(find_occlusion(scene), LIGHT)
    assert shows(find_occlusion(scene, pictures / "dark.png"), DARK)


@pytest.mark.parametrize(
    ("text", "texture", "said"),
    [
        (f"{TRIANGLE}f 1/1 2/2 3/3\n", None, r"no made\.png beside it; pass one with texture"),
        (f"{TRIANGLE}f 1 2 3\n", "light.png", "has no UVs"),
        (f"{TRIANGLE}f 1/1 2/2 3/3\n", "none.png", "there is no such file"),
        (f"{TRIANGLE}f 1/1 2/2 3/3\n", "made.obj", "cannot be read as an image"),
        (f"{TRIANGLE}f 1/1 2/2 3/3\n", "nan.exr", "not finite"),
    ],
)
def test_what_is_missing_is_said(save, pictures, text, texture, said):
    write_image(pictures / "nan.exr", np.full((2, 2), np.nan, np.float32))
    scene = load_scene(save("made.obj", text))
    with pytest.raises(InputError, match=said):
        find_occlusion(scene, None if texture is None else pictures / texture)


def test_embedded_bytes_that_are_no_picture_are_called_by_their_name():
    with pytest.raises(InputError) as failure:
        decode_pixels(b"not a picture", "image 3 of a.glb")
    assert str(failure.value).startswith("image 3 of a.glb: cannot be read as an image")
    assert "/tmp" not in str(failure.value)


def test_alpha_does_not_darken_what_is_read(tmp_path):
    from PIL import Image

    pixels = np.full((4, 4, 4), 200, np.uint8)
    pixels[..., 3] = 10
    Image.fromarray(pixels).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png") == pytest.approx(200 / 255, abs=1e-6)


# As pictures show it.


def two_materials(maker, primitive, pictures):
    """A cube of two primitives whose materials have occlusion textures of their own."""
    primitives = []
    for picture in pictures:
        texture = {"index": maker.texture(np.round(255 * picture))}
        material = maker.add("materials", {"occlusionTexture": texture})
        primitives.append(primitive | {"material": material})
    maker.node(mesh=maker.mesh(*primitives))
    return maker.save()


@pytest.mark.parametrize("kind", ["alike", "different"])
def test_textures_of_several_materials_are_joined(gltf_cube, kind):
    """As a packed bake writes them: alike in occlusion; or as other programs do: different, and of any size."""
    first = np.random.default_rng(0).random((4, 8)).round(2)
    second = first if kind == "alike" else np.random.default_rng(1).random((6, 3)).round(2)
    maker, primitive = gltf_cube
    mesh = mesh_to_draw(
        two_materials(maker, primitive, [np.stack([it, it, it * 0], -1) for it in (first, second)])
    ).mesh
    assert mesh.textured.all()
    assert mesh.ao.shape == (first.shape if kind == "alike" else (4 + 6 + 4 * 16, 8))
    own, rng = mesh.scene.uvs, np.random.default_rng(2)
    weights = rng.dirichlet([1, 1, 1], len(own))
    for part, picture in zip(mesh.scene.parts, (first, second), strict=True):
        uvs, moved = (np.einsum("fc,fcx->fx", weights[part.faces], of[part.faces]) for of in (own, mesh.uvs))
        height, width = picture.shape
        inner = (np.abs(uvs * (width, height) % 1 - 0.5) < 0.49).all(axis=1)  # not on the border of a texel
        rows, columns = ((1 - uvs[:, 1]) * height).astype(int), (uvs[:, 0] * width).astype(int)
        texel = mesh.ao[((1 - moved[:, 1]) * len(mesh.ao)).astype(int), (moved[:, 0] * mesh.ao.shape[1]).astype(int)]
        assert np.abs(texel - picture[rows, columns])[inner].max() < 1 / 255


def test_it_is_told_on_which_uv_set_a_given_texture_is(gltf_cube):
    maker, primitive = gltf_cube
    primitive["attributes"]["TEXCOORD_1"] = maker.accessor(np.random.default_rng(0).random((24, 2)).astype("<f4"))
    maker.node(mesh=maker.mesh(primitive))
    found = mesh_to_draw(maker.save(), np.ones((2, 2)))
    assert found.messages == ("texture: is drawn on UV set 0 of 2 (from 0)",)
