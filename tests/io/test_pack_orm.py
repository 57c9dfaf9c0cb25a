"""`pack="orm"`: occlusion, roughness and metalness in one picture, where they have the same UVs."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from aoprecalc.api.bake import bake_file
from aoprecalc.io import Outputs, load_scene, read_image, write_image
from aoprecalc.io.images import decode_text, read_text
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_documents import APART, corner
from gltf_kit.gltf_maker import png
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues
from written_meshes import write_with_one_texture

AO = np.linspace(0, 255, 64).round().astype(np.uint8).reshape(8, 8)
ROUGHNESS = np.random.default_rng(7).integers(0, 256, (8, 8, 3), np.uint8)
OTHER = np.random.default_rng(8).integers(0, 256, (8, 8, 3), np.uint8)
REPEAT, MIRROR, CLAMP = 10497, 33648, 33071


@pytest.fixture
def pack(tmp_path, atlas_of):
    """pack(scene, name, ...) writes a mesh with its own normals; returns (path, warnings)."""

    def write(scene, name, method="keep", *, ao=AO / 255, texture="x_ao.png", depth="auto", **members):
        atlas = replace(atlas_of(scene, method), **members)
        path = tmp_path / "out" / name
        with Outputs() as outputs:
            outputs.folder(path.parent)
            picture = path.parent / texture
            write_image(outputs.path(picture), ao.astype(np.float32), depth)
            warnings = write_with_one_texture(outputs, path, scene, atlas, scene.normals, picture, pack="orm").messages
        return path, warnings

    return write


@pytest.fixture
def cubes(gltf_cube):
    """cubes(material, ...) -> a maker with a cube of each."""

    def make(*materials):
        maker, primitive = gltf_cube
        for at, material in enumerate(materials):
            number = maker.add("materials", material)
            maker.node(mesh=maker.mesh(primitive | {"material": number}), translation=[3 * at, 0, 0])
        return maker

    return make


def rough(texture, **members):
    return {"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": texture, **members}}}


def occlusion_info(texture):
    """How a material uses an occlusion texture that was baked for the first set of UVs."""
    return {"index": texture, "texCoord": 0, "strength": 1}


def infos(document, at=0):
    """The textureInfos of roughness and of occlusion."""
    material = document.json["materials"][at]
    return material.get("pbrMetallicRoughness", {}).get("metallicRoughnessTexture"), material["occlusionTexture"]


def pixels(document, info):
    data = document.texture(info["index"])["source"][0]
    return np.asarray(Image.open(io.BytesIO(data)))


@pytest.mark.parametrize("place", ["view", "data", "my rough.png"])
@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_channels_are_occlusion_roughness_and_metalness(cubes, gltf, pack, tmp_path, name, place):
    sampler = {"magFilter": 9728, "wrapS": MIRROR, "name": "blocks"}
    texture = gltf.texture(ROUGHNESS, place, sampler)
    if place == "my rough.png":
        gltf.json["images"][0]["uri"] = "my%20rough.png"
    maker = cubes(rough(texture, extras={"of": "ours"}) | {"name": "paint"})
    path, warnings = pack(maker.load("made.gltf" if place == "my rough.png" else "made.glb"), name)
    assert warnings == ()
    document = GltfValues(path)
    roughness, occlusion = infos(document)
    assert roughness == {"index": 0, "extras": {"of": "ours"}}
    assert occlusion == occlusion_info(0)
    assert document.texture(0)["sampler"] == sampler
    assert np.array_equal(pixels(document, occlusion), np.dstack([AO, ROUGHNESS[:, :, 1:]]))
    assert np.array_equal(np.asarray(Image.open(path.parent / "x_ao.png")), AO)
    assert [len(document.json[kind]) for kind in ("textures", "images", "samplers")] == [1, 1, 1]
    files = {"a.glb": {"a.glb"}, "a.gltf": {"a.gltf", "a.bin", "x_ao_orm.png"}}[name]
    assert {file.name for file in path.parent.iterdir()} == files | {"x_ao.png"}
    if name == "a.glb":
        assert document.json["images"][0]["name"] == "x_ao_orm"


def test_the_packed_picture_is_linear(cubes, gltf, pack):
    path, _ = pack(cubes(rough(gltf.texture(ROUGHNESS))).load(), "a.gltf")
    data = (path.parent / "x_ao_orm.png").read_bytes()
    assert Image.open(io.BytesIO(data)).mode == "RGB"
    assert b"sRGB" not in data
    assert b"iCCP" not in data


def enlarged(values, shape, mode):
    """(h, w) values, bilinearly at the texel centres of a larger picture."""
    for _ in range(2):
        size = shape[len(values.shape) - 2]
        padded = np.pad(values.astype(float), ((1, 1), (0, 0)), mode)
        centres = (np.arange(len(padded)) - 0.5) / len(values)
        places = (np.arange(size) + 0.5) / size
        values = np.stack([np.interp(places, centres, column) for column in padded.T])
        shape = shape[::-1]
    return values


@pytest.mark.parametrize(("wrap", "mode"), [(REPEAT, "wrap"), (MIRROR, "symmetric"), (CLAMP, "edge")])
@pytest.mark.parametrize(("own", "other"), [((8, 8), (3, 5)), ((3, 4), (7, 9)), ((8, 3), (5, 6)), ((1, 1), (2, 3))])
def test_the_smaller_picture_is_enlarged(cubes, gltf, pack, own, other, wrap, mode):
    rng = np.random.default_rng(wrap)
    ao, roughness = rng.integers(0, 256, own), rng.integers(0, 256, (*other, 3))
    texture = gltf.texture(roughness, sampler={"wrapS": wrap, "wrapT": wrap})
    path, _ = pack(cubes(rough(texture)).load(), "a.glb", ao=ao / 255)
    packed = pixels(GltfValues(path), infos(GltfValues(path))[1]).astype(float)
    shape = tuple(np.maximum(own, other))
    assert packed.shape == (*shape, 3)
    sources = [(ao, "edge"), (roughness[:, :, 1], mode), (roughness[:, :, 2], mode)]
    for channel, (values, beyond) in enumerate(sources):
        assert abs(packed[:, :, channel] - enlarged(values, shape, beyond)).max() <= 0.5 + 1e-3


def test_each_axis_wraps_as_its_sampler_says(cubes, gltf, pack):
    roughness = np.zeros((2, 2, 3), np.uint8)
    roughness[0, 0] = 255
    texture = gltf.texture(roughness, sampler={"wrapS": REPEAT, "wrapT": CLAMP})
    path, _ = pack(cubes(rough(texture)).load(), "a.glb", ao=np.ones((4, 4)))
    packed = pixels(GltfValues(path), infos(GltfValues(path))[1])
    across, down = np.array([0.75, 0.75, 0.25, 0.25]), np.array([1, 0.75, 0.25, 0])
    assert np.array_equal(packed[:, :, 1], np.floor(255 * down[:, None] * across + 0.5))


def test_where_uvs_wrap_so_does_the_enlarged_occlusion(cubes, gltf, pack):
    ao = np.array([[0.0, 1.0]])
    path, warnings = pack(cubes(rough(gltf.texture(ROUGHNESS[:1, :4]))).load(), "a.glb", ao=ao, repeats=True)
    packed = pixels(GltfValues(path), infos(GltfValues(path))[1])
    assert packed[0, :, 0].tolist() == [64, 64, 191, 191]
    assert warnings == ()


@pytest.mark.parametrize(
    ("picture", "roughness", "metalness"),
    [
        (ROUGHNESS[:, :, 0], ROUGHNESS[:, :, 0], ROUGHNESS[:, :, 0]),
        (np.dstack([ROUGHNESS, OTHER[:, :, 0]]), ROUGHNESS[:, :, 1], ROUGHNESS[:, :, 2]),
        (np.dstack([ROUGHNESS[:, :, 0], OTHER[:, :, 0]]), ROUGHNESS[:, :, 0], ROUGHNESS[:, :, 0]),
    ],
    ids=["grey", "with alpha", "grey with alpha"],
)
def test_whatever_channels_the_picture_has(cubes, gltf, pack, picture, roughness, metalness):
    path, _ = pack(cubes(rough(gltf.texture(picture))).load(), "a.glb")
    packed = pixels(GltfValues(path), infos(GltfValues(path))[1])
    assert np.array_equal(packed, np.dstack([AO, roughness, metalness]))


@pytest.mark.parametrize(("texture", "depth"), [("x_ao.png", "16"), ("x_ao.exr", "float"), ("x_ao.tif", "16")])
def test_finer_occlusion_is_rounded(cubes, gltf, pack, texture, depth):
    ao = np.array([[0.0, 0.3, 0.501, 1.0]])
    maker = cubes(rough(gltf.texture(ROUGHNESS[:1, :4])))
    path, warnings = pack(maker.load(), "a.gltf", ao=ao, texture=texture, depth=depth)
    packed = pixels(GltfValues(path), infos(GltfValues(path))[1])
    assert packed[0, :, 0].tolist() == [0, 77, 128, 255]
    assert warnings == ()  # there is no copy of the plain texture that glTF could hold
    assert {file.name for file in path.parent.iterdir()} == {"a.gltf", "a.bin", texture, "x_ao_orm.png"}


@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
def test_materials_share_packed_pictures_as_they_shared_the_others(cubes, gltf, pack, name):
    first, second = gltf.texture(ROUGHNESS), gltf.texture(OTHER, sampler={"wrapS": CLAMP})
    again = gltf.add("textures", {"source": 0, "sampler": 0})  # the first picture as the second one wraps
    maker = cubes(rough(first), rough(second), rough(first), rough(again))
    path, warnings = pack(maker.load(), name)
    assert warnings == ()
    document = GltfValues(path)
    textures = [[info["index"] for info in infos(document, at)] for at in range(4)]
    assert textures == [[0, 0], [1, 1], [0, 0], [2, 2]]
    for texture, picture in ((0, ROUGHNESS), (1, OTHER), (2, ROUGHNESS)):
        packed = pixels(document, {"index": texture})
        assert np.array_equal(packed, np.dstack([AO, picture[:, :, 1:]]))
    assert document.json["textures"] == [{"source": 0}, {"sampler": 0, "source": 1}, {"sampler": 0, "source": 0}]
    assert len(document.json["images"]) == 2
    if name == "a.gltf":
        assert [image["uri"] for image in document.json["images"]] == ["x_ao_orm.png", "x_ao_orm_1.png"]
    else:
        assert [image["name"] for image in document.json["images"]] == ["x_ao_orm", "x_ao_orm_1"]


MOVED = {"KHR_texture_transform": {"offset": [0.5, 0]}}


@pytest.mark.parametrize(
    ("material", "options", "reason"),
    [
        ({"pbrMetallicRoughness": {}}, {}, "without a metallic-roughness texture"),
        (rough(0), {"method": "xatlas", "uv_set": None}, "on other UVs than those of the bake"),
        (rough(0, texCoord=1), {}, "on other UVs"),
        (rough(0, extensions=MOVED), {}, "is transformed"),
        (rough(0, extensions={"KHR_texture_transform": {"rotation": 1}}), {}, "is transformed"),
        (rough(0, extensions={"KHR_texture_transform": {"scale": [1, -1]}}), {}, "is transformed"),
        (rough(0, extensions={"KHR_texture_transform": {"texCoord": 1}}), {}, "on other UVs"),
        (rough(1), {"repeats": True}, "does not repeat as the UVs do"),
        (rough(2), {}, "image cannot be read"),
        (rough(3), {}, "image cannot be read"),
        (rough(4), {}, "image cannot be read"),
        (rough(5), {}, "image cannot be read"),
    ],
    ids=[
        "none",
        "new UVs",
        "other UVs",
        "moved",
        "turned",
        "flipped",
        "overridden set",
        "clamped",
        "KTX2",
        "missing",
        "remote",
        "no source",
    ],
)
def test_what_cannot_be_packed_keeps_its_roughness(cubes, gltf, pack, material, options, reason):
    gltf.texture(ROUGHNESS)
    gltf.add("samplers", {"wrapS": CLAMP})
    gltf.add("textures", {"source": 0, "sampler": 0})
    ktx = gltf.add(
        "images", {"bufferView": gltf.view(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(99)), "mimeType": "image/ktx2"}
    )
    gltf.add("textures", {"extensions": {"KHR_texture_basisu": {"source": ktx}}})
    for uri in ("none.png", "https://example.com/a.png"):
        gltf.add("textures", {"source": gltf.add("images", {"uri": uri})})
    gltf.add("textures", {})
    maker = cubes(material)
    path, warnings = pack(maker.load("made.gltf"), "a.gltf", **{"uv_set": 0, **options})
    about = [line for line in warnings if "not packed" in line]
    assert len(about) == 1
    assert about[0].startswith("1 of 1 material gets an occlusion image that is not packed: 1 with")
    assert reason in about[0]
    document = GltfValues(path)
    roughness, occlusion = infos(document)
    assert roughness == material["pbrMetallicRoughness"].get("metallicRoughnessTexture")
    assert np.array_equal(pixels(document, occlusion), AO)
    assert not (path.parent / "x_ao_orm.png").exists()


def test_one_warning_counts_the_reasons(cubes, gltf, pack):
    texture = gltf.texture(ROUGHNESS)
    maker = cubes(rough(texture), {}, rough(texture, texCoord=1), {"name": "bare"})
    path, warnings = pack(maker.load(), "a.glb")
    assert warnings == (
        "3 of 4 materials get an occlusion image that is not packed: 2 without a metallic-roughness "
        "texture, 1 with one on other UVs than those of the bake",
    )
    document = GltfValues(path)
    found = [material["occlusionTexture"]["index"] for material in document.json["materials"]]
    assert found[1:] == [found[1]] * 3
    assert np.array_equal(pixels(document, {"index": found[0]}), np.dstack([AO, ROUGHNESS[:, :, 1:]]))
    assert np.array_equal(pixels(document, {"index": found[1]}), AO)
    # The third material still has its own, the first one's is packed.
    assert document.texture(texture)["source"][0] == png(ROUGHNESS)
    assert len(document.json["textures"]) == len(document.json["images"]) == 3


@pytest.mark.parametrize(
    "extension",
    [{}, {"offset": [0, 0], "scale": [1, 1], "rotation": 0}, {"texCoord": 0}],
    ids=["empty", "of defaults", "of the set"],
)
def test_a_transform_that_changes_nothing_is_no_obstacle(cubes, gltf, pack, extension):
    info = {"extensions": {"KHR_texture_transform": extension}} | ({"texCoord": 3} if "texCoord" in extension else {})
    path, warnings = pack(cubes(rough(gltf.texture(ROUGHNESS), **info)).load(), "a.glb")
    assert warnings == ()
    roughness, occlusion = infos(GltfValues(path))
    assert roughness == {"index": 0, **info}
    assert occlusion == occlusion_info(0)


def test_the_second_set_was_kept(gltf_cube, pack):
    maker, primitive = gltf_cube
    attributes = primitive["attributes"] | {"TEXCOORD_1": primitive["attributes"]["TEXCOORD_0"]}
    for number in (0, 1):
        material = maker.add("materials", rough(maker.texture(ROUGHNESS), texCoord=number))
        maker.node(mesh=maker.mesh(primitive | {"attributes": attributes, "material": material}))
    path, warnings = pack(maker.load(), "a.glb", uv_set=1)
    assert "1 of 2 materials" in warnings[0]
    document = GltfValues(path)
    assert [info["texCoord"] for info in infos(document, 1)] == [1, 1]
    assert np.array_equal(pixels(document, infos(document, 1)[0])[:, :, 1:], ROUGHNESS[:, :, 1:])
    assert infos(document, 0)[1]["texCoord"] == 1
    assert pixels(document, infos(document, 0)[1]).ndim == 2


def test_uvs_that_are_new_although_the_set_has_the_same_number(gltf, pack):
    """A primitive without UVs whose material asks for TEXCOORD_0: the atlas becomes that set."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    material = gltf.add("materials", rough(gltf.texture(ROUGHNESS)))
    normals = np.array([[0, 0, 1]] * 3, "<f4")
    attributes = {"POSITION": gltf.vertices(points, bounds=True), "NORMAL": gltf.vertices(normals)}
    gltf.node(mesh=gltf.mesh({"attributes": attributes, "material": material}))
    path, warnings = pack(gltf.load(), "a.glb", "xatlas")
    assert infos(GltfValues(path)) == ({"index": 0}, occlusion_info(1))
    assert "on other UVs" in warnings[0]


def test_a_picture_that_held_all_three_gets_new_occlusion(cubes, gltf, pack):
    info = {"index": gltf.texture(ROUGHNESS)}
    path, warnings = pack(cubes(rough(0) | {"occlusionTexture": info | {"strength": 0.5}}).load(), "a.glb")
    assert warnings == ("the occlusion textures of 1 material were replaced; their strength is 1, it was 0.5",)
    document = GltfValues(path)
    assert infos(document) == (info, occlusion_info(info["index"]))
    assert np.array_equal(pixels(document, info), np.dstack([AO, ROUGHNESS[:, :, 1:]]))
    assert len(document.json["images"]) == 1


def test_a_picture_that_others_need_stays(cubes, gltf, pack):
    texture = gltf.texture(ROUGHNESS)
    coat = {"KHR_materials_clearcoat": {"clearcoatRoughnessTexture": {"index": texture}}}
    path, _ = pack(cubes(rough(texture) | {"extensions": coat}).load(), "a.glb")
    document = GltfValues(path)
    material = document.json["materials"][0]
    assert material["extensions"] == coat
    assert document.texture(texture)["source"][0] == png(ROUGHNESS)
    assert infos(document) == ({"index": 1}, occlusion_info(1))


def test_names_leave_those_of_carried_files_alone(cubes, gltf, pack):
    texture, base = gltf.texture(ROUGHNESS), gltf.texture(OTHER, "x_ao_orm.png")
    material = rough(texture)
    material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": base}
    path, _ = pack(cubes(material).load("made.gltf"), "a.gltf")
    document = GltfValues(path)
    assert document.texture(base)["source"][0] == png(OTHER)
    assert np.array_equal(pixels(document, infos(document)[1]), np.dstack([AO, ROUGHNESS[:, :, 1:]]))
    assert [image["uri"] for image in document.json["images"]] == ["x_ao_orm_1.png", "x_ao_orm.png"]


def test_a_second_bake_writes_the_same_files(cubes, gltf, pack):
    scene = cubes(rough(gltf.texture(ROUGHNESS))).load()
    contents = []
    for _ in range(2):
        path, _ = pack(scene, "a.gltf")
        contents.append({file.name: file.read_bytes() for file in path.parent.iterdir()})
    assert contents[0] == contents[1]


def test_a_mesh_of_another_kind_has_nothing_to_pack(cube_obj, pack):
    path, warnings = pack(load_scene(cube_obj), "a.glb")
    assert len([line for line in warnings if "without a metallic-roughness texture" in line]) == 1
    document = GltfValues(path)
    assert np.array_equal(pixels(document, document.json["materials"][0]["occlusionTexture"]), AO)


@needs_validator
@pytest.mark.parametrize("kind", ["gltf", "glb"])
def test_a_whole_bake_gives_a_valid_document(gltf, tmp_path, kind):
    material = gltf.add("materials", rough(gltf.texture(ROUGHNESS)) | {"occlusionTexture": {"index": 0}})
    plain = gltf.add("materials", {"occlusionTexture": {"index": gltf.texture(OTHER)}})
    gltf.node(mesh=gltf.mesh(corner(gltf, APART / 2, material=material)))
    gltf.node(mesh=gltf.mesh(corner(gltf, APART / 2 + 0.5, material=plain)), translation=[3, 0, 0])
    path, out = gltf.save(f"made.{kind}", binary="made.bin"), tmp_path / "out"
    out.mkdir()
    result = bake_file(path, out, options=BakeOptions(size=32, directions=64, pack="orm"))
    assert new_issues(path, result.files.mesh) == []
    document, (ao, *_) = GltfValues(result.files.mesh), read_image(result.files.texture)
    said = [infos(document, index)[1].pop("extras")["aoprecalc"] for index in (0, 1)]
    text = json.loads(read_text(result.files.texture))
    assert [options | {"triangles": text["triangles"]} for options in said] == [text] * 2
    assert decode_text(document.texture(0)["source"][0]) == read_text(result.files.texture)  # of the packed image
    assert infos(document, 0) == ({"index": 0}, occlusion_info(0))
    assert pixels(document, {"index": 0})[0, :, 0].tolist() == np.rint(255 * ao).tolist()
    assert infos(document, 1) == (None, occlusion_info(1))
