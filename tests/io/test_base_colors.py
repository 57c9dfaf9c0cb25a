"""The base colours of materials, as the files of each format state them."""

import struct

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene, write_image
from aoprecalc.io.images import read_colors
from aoprecalc.io.meshes import base_colors
from aoprecalc.texture_lookup import linear_from_srgb
from gltf_kit.gltf_maker import png

PIXELS = np.random.default_rng(1).integers(0, 256, (4, 8, 3), np.uint8)
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
WITH_UVS = "f 1/1 2/2 3/3\n"


@pytest.fixture
def picture(tmp_path):
    (tmp_path / "skin.png").write_bytes(png(PIXELS))
    return tmp_path / "skin.png"


def colors_of(path, **more):
    colors, warnings = base_colors(load_scene(path), **more)
    return (*colors, *warnings)


def gltf(maker, primitive, material, name="cube.glb"):
    """The base colours of a cube of one material, and its warnings."""
    primitive["material"] = maker.add("materials", material)
    maker.node(mesh=maker.mesh(primitive))
    return colors_of(maker.save(name))


def test_gltf_states_a_factor(gltf_cube):
    (color,) = gltf(*gltf_cube, {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 0.5]}})
    assert color.factor == (0.2, 0.4, 0.6)
    assert (color.texture, color.uvs, color.corners) == (None, None, None)


@pytest.mark.parametrize("place", ["view", "data", "skin.png"])
@pytest.mark.parametrize("extension", ["", "KHR_materials_pbrSpecularGlossiness"])
def test_gltf_states_a_texture_and_its_transform(gltf_cube, place, extension):
    maker, primitive = gltf_cube
    uvs = np.random.default_rng(0).random((24, 2)).astype("<f4")
    primitive["attributes"]["TEXCOORD_1"] = maker.accessor(uvs)
    transform = {"offset": [0.25, 0.5], "scale": [2, 3], "texCoord": 1}
    info = {"index": maker.texture(PIXELS, place), "extensions": {"KHR_texture_transform": transform}}
    material = {"pbrMetallicRoughness": {"baseColorTexture": info}}
    if extension:
        material = {"extensions": {extension: {"diffuseTexture": info, "diffuseFactor": [1, 1, 0.5, 1]}}}
    (color,) = gltf(maker, primitive, material, "cube.gltf")
    assert color.factor == ((1, 1, 0.5) if extension else (1, 1, 1))
    assert np.array_equal(color.texture, PIXELS)
    down = uvs[load_scene(maker.folder / "cube.gltf").parts[0].vertices] * (2, 3) + (0.25, 0.5)
    assert np.allclose(color.uvs, down * (1, -1) + (0, 1), atol=1e-6)


def test_gltf_has_colors_of_vertices(gltf_cube):
    maker, primitive = gltf_cube
    given = np.random.default_rng(0).integers(0, 256, (24, 4), np.uint8)
    primitive["attributes"]["COLOR_0"] = maker.accessor(given, normalized=True)
    (color,) = gltf(maker, primitive, {})
    vertices = load_scene(maker.folder / "cube.glb").parts[0].vertices
    assert np.allclose(color.corners, given[vertices][..., :3] / 255, atol=1e-6)


def test_a_primitive_without_a_material_is_white(gltf_cube):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive))
    (color,) = colors_of(maker.save("cube.glb"))
    assert (color.factor, color.texture) == ((1, 1, 1), None)


@pytest.mark.parametrize("damage", ["missing", "broken", "no source"])
def test_a_missing_or_broken_texture_is_left_out_with_a_warning_that_names_it(gltf_cube, damage):
    maker, primitive = gltf_cube
    texture = maker.texture(PIXELS, "skin.png")
    if damage == "missing":
        (maker.folder / "skin.png").unlink()
    elif damage == "broken":
        (maker.folder / "skin.png").write_bytes(b"no picture")
    else:
        del maker.json["textures"][texture]["source"]
    pbr = {"baseColorTexture": {"index": texture}, "baseColorFactor": [0.5, 0.5, 0.5, 1]}
    color, warning = gltf(maker, primitive, {"pbrMetallicRoughness": pbr}, "cube.gltf")
    assert (color.factor, color.texture) == ((0.5, 0.5, 0.5), None)
    assert warning.startswith("a base colour is drawn without its texture: ")
    assert ("skin.png" in warning) == (damage != "no source")


def test_damaged_materials_are_an_input_error(gltf_cube):
    maker, primitive = gltf_cube
    with pytest.raises(InputError, match="its materials cannot be read"):
        gltf(maker, primitive, {"pbrMetallicRoughness": {"baseColorFactor": "red"}})


def obj(folder, material):
    (folder / "made.mtl").write_text(f"newmtl paint\n{material}\n")
    (folder / "made.obj").write_text(f"mtllib made.mtl\n{TRIANGLE}usemtl paint\n{WITH_UVS}")
    return folder / "made.obj"


def test_obj_states_kd_in_srgb(tmp_path):
    (color,) = colors_of(obj(tmp_path, "Kd 0.5 0 1"))
    assert color.factor == pytest.approx((((0.5 + 0.055) / 1.055) ** 2.4, 0, 1))
    assert color.texture is None


@pytest.mark.parametrize(("kd", "factor"), [("Kd 1 0 0", (1, 0, 0)), ("Kd 0 0 0", (1, 1, 1)), ("", (1, 1, 1))])
def test_obj_states_a_texture(picture, kd, factor):
    mesh = obj(picture.parent, f"{kd}\nmap_Kd skin.png")
    (color,) = colors_of(mesh)
    assert color.factor == pytest.approx(factor)
    assert np.array_equal(color.texture, PIXELS)
    assert np.array_equal(color.uvs, load_scene(mesh).uvs)


def test_ambient_occlusion_is_no_base_color(picture):
    (color,) = colors_of(obj(picture.parent, "Kd 1 1 1\nmap_Kd skin.png"), occlusion=picture.parent / "." / "skin.png")
    assert (color.factor, color.texture) == ((1, 1, 1), None)


def test_a_texture_without_uvs_is_left_out(picture):
    mesh = obj(picture.parent, "map_Kd skin.png")
    mesh.write_text(mesh.read_text().replace(WITH_UVS, "f 1 2 3\n"))
    (color,) = colors_of(mesh)
    assert (color.texture, color.uvs) == (None, None)


def ply(folder, kind, rows, comment=""):
    lines = [f"property {kind} {name}" for name in ("red", "green", "blue")]
    head = ["ply", "format ascii 1.0", *comment, "element vertex 3", *(f"property float {axis}" for axis in "xyzst")]
    head += [*lines, "element face 1", "property list uchar int vertex_indices", "end_header"]
    body = [f"{x} {y} 0 {x} {y} {r} {g} {b}" for (x, y), (r, g, b) in zip([(0, 0), (1, 0), (0, 1)], rows, strict=True)]
    (folder / "made.ply").write_text("\n".join([*head, *body, "3 0 1 2"]) + "\n")
    return folder / "made.ply"


@pytest.mark.parametrize(("kind", "scale"), [("uchar", 255), ("float", 1)])
def test_ply_has_colors_of_vertices_in_srgb(tmp_path, kind, scale):
    (color,) = colors_of(ply(tmp_path, kind, [(scale, 0, 0), (0, scale, 0), (0, 0, scale)]))
    assert np.array_equal(color.corners[0], np.eye(3))
    assert color.texture is None


def test_ply_names_a_texture(picture):
    mesh = ply(picture.parent, "uchar", np.full((3, 3), 255), ["comment TextureFile skin.png"])
    (color,) = colors_of(mesh)
    assert np.array_equal(color.texture, PIXELS)
    assert np.array_equal(color.uvs[0], [(0, 0), (1, 0), (0, 1)])
    (color,) = colors_of(mesh, occlusion=picture)
    assert color.texture is None


def test_formats_without_colors_have_none(tmp_path):
    values = (0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0)
    (tmp_path / "made.stl").write_bytes(bytes(80) + struct.pack("<I12fH", 1, *values, 0))
    assert colors_of(tmp_path / "made.stl") == ()


def test_a_grey_picture_has_three_equal_channels(tmp_path):
    write_image(tmp_path / "grey.png", np.array([[0, 1]], np.float32))
    assert read_colors(tmp_path / "grey.png").tolist() == [[[0, 0, 0], [255, 255, 255]]]


def test_srgb_is_undone():
    linear = np.linspace(0, 1, 100)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.allclose(linear_from_srgb(srgb), linear, atol=1e-6)
