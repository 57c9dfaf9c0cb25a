"""What an MTL says of colours, opacity and pictures reaches the bake, the base colours and a GLB made of the OBJ."""

import numpy as np
import pytest
import trimesh
from PIL import Image

import aoprecalc
from aoprecalc import BakeOptions
from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors, output_mesh_extension
from aoprecalc.texture_lookup import linear_from_srgb
from gltf_kit.gltf_validator import ERROR, issues, needs_validator

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1.5 0\nvt 1.5 1\nvt 0 1\nusemtl leaf\nf 1/1 2/2 3/3 4/4\n"
COLORS = np.random.default_rng(5).integers(0, 256, (4, 6, 3), dtype=np.uint8)
HOLES = np.where(np.arange(24).reshape(4, 6) % 3 == 0, 0, 255).astype(np.uint8)
SMOOTH = np.linspace(20, 250, 24).astype(np.uint8).reshape(4, 6)


def rgba(alpha):
    return np.concatenate([COLORS, np.asarray(alpha, np.uint8)[:, :, None]], axis=2)


@pytest.fixture
def make(tmp_path):
    """make(mtl, {name: pixels}, obj) -> the scene of a textured square."""

    def make_obj(mtl, pictures=None, text=QUAD):
        for name, pixels in (pictures or {}).items():
            Image.fromarray(pixels).save(tmp_path / name)
        (tmp_path / "a.mtl").write_text(f"newmtl leaf\n{mtl}\n")
        (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{text}")
        return load_scene(tmp_path / "a.obj")

    return make_obj


def material_of(path):
    (material,) = load_scene(path).document.json["materials"]
    return material


def picture_of(path):
    (mesh,) = trimesh.load_scene(path).geometry.values()
    return np.asarray(mesh.visual.material.baseColorTexture)


@pytest.mark.parametrize(
    ("mtl", "opacity"),
    [
        ("", 1),
        ("d 1", 1),
        ("d 0.25", 0.25),
        ("d 0.25 # of glass", 0.25),
        ("D 0.25#", 0.25),
        ("d -halo 0.25", 0.25),
        ("Tr 0.25", 0.75),
        ("Tr 0", 1),
        ("d 0.25\nTr 0.25", 0.25),
        ("Tr 0.25\nd 1", 1),
        ("d nan", 1),
        ("d 7", 1),
        ("d", 1),
    ],
)
def test_opacity_blends(make, bake, mtl, opacity):
    scene = make(mtl)
    assert scene.parts[0].material.transparent == (opacity < 1)
    path, *_ = bake(scene, "a_ao.glb")
    material = material_of(path)
    assert material.get("alphaMode", "OPAQUE") == ("BLEND" if opacity < 1 else "OPAQUE")
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, opacity]


@pytest.mark.parametrize("mtl", ["d 0", "Tr 1", "d 0\nTr 1"])
def test_what_would_be_hidden_is_opaque_and_told(make, mtl):
    scene = make(mtl)
    assert not scene.parts[0].material.transparent
    assert "'leaf' has an opacity of 0" in scene.warnings[0]


MASKS = {
    "its own alpha": ("map_d c.png", {"c.png": rgba(HOLES)}, HOLES),
    "another picture": ("map_d m.png", {"c.png": COLORS, "m.png": HOLES}, HOLES),
    "another picture's alpha": ("map_d m.png", {"c.png": COLORS, "m.png": rgba(HOLES)}, HOLES),
    "a channel": ("map_d -imfchan g m.png", {"c.png": COLORS, "m.png": np.dstack([HOLES * 0, HOLES, HOLES])}, HOLES),
    "luminance beside alpha": ("map_d -imfchan l m.png", {"c.png": COLORS, "m.png": np.dstack([HOLES, HOLES])}, HOLES),
    "the alpha of map_Kd": ("", {"c.png": rgba(HOLES)}, HOLES),
    "smooth": ("map_d m.png", {"c.png": COLORS, "m.png": SMOOTH}, SMOOTH),
    "smooth and its own": ("map_d c.png", {"c.png": rgba(SMOOTH)}, SMOOTH),
}


@pytest.mark.parametrize("case", MASKS)
def test_opacity_maps_reach_bake_and_glb(make, bake, case):
    line, pictures, alpha = MASKS[case]
    scene = make(f"map_Kd c.png\n{line}", pictures)
    material, is_mask = scene.parts[0].material, alpha is HOLES
    assert material.transparent == (not is_mask)
    path, *_ = bake(scene, "a_ao.glb")
    assert material_of(path)["alphaMode"] == ("MASK" if is_mask else "BLEND")
    assert np.array_equal(picture_of(path), rgba(alpha))
    if is_mask:
        back = load_scene(path).parts[0].material.alpha_mask
        assert np.array_equal(material.alpha_mask.alpha, alpha / np.float32(255))
        assert np.array_equal(back.alpha, material.alpha_mask.alpha)
        assert back.uvs == pytest.approx(material.alpha_mask.uvs)


def test_an_opacity_map_of_another_size_and_no_colours(make, bake):
    alpha = HOLES.repeat(2, axis=0).repeat(2, axis=1)
    path, *_ = bake(make("Kd 0 0 1\nmap_d m.png", {"m.png": alpha}), "a_ao.glb")
    assert np.array_equal(picture_of(path)[:, :, 3], alpha)
    assert material_of(path)["pbrMetallicRoughness"]["baseColorFactor"] == [0, 0, 1, 1]
    path, *_ = bake(make("map_Kd c.png\nmap_d m.png", {"c.png": COLORS, "m.png": alpha}), "b_ao.glb")
    assert np.array_equal(picture_of(path)[:, :, 3], alpha)


@pytest.mark.parametrize(
    ("mtl", "pictures", "said"),
    [
        ("map_Kd c.png", {"c.png": rgba(SMOOTH)}, "the alpha of c.png is no mask and not used"),
        ("map_Kd c.png", {"c.png": rgba(SMOOTH * 0)}, "the alpha of c.png is no mask and not used"),
        ("map_Kd c.png\nmap_d none.png", {"c.png": COLORS}, "'none.png' is not there"),
        ("map_Kd -s 2 2 c.png\nmap_d m.png", {"c.png": COLORS, "m.png": HOLES}, "map_d is left out"),
        ("map_Kd c.png\nmap_d a.mtl", {"c.png": COLORS}, "is taken as opaque: "),
    ],
)
def test_what_is_not_used_is_told(make, bake, mtl, pictures, said):
    scene = make(mtl, pictures)
    assert said in scene.warnings[0]
    assert len(scene.warnings) == 1
    path, *_ = bake(scene, "a_ao.glb")
    assert "alphaMode" not in material_of(path)
    assert np.array_equal(picture_of(path)[:, :, :3], COLORS)


@pytest.mark.parametrize("holes", ["c.png", "m.png"])
@pytest.mark.parametrize("pixels", [COLORS, rgba(HOLES * 0 + 255)], ids=["rgb", "rgba"])
def test_an_alpha_that_is_whole_is_none(make, pixels, holes):
    scene = make(f"map_Kd c.png\nmap_d {holes}", {"c.png": pixels, "m.png": HOLES * 0 + 255})
    assert (scene.parts[0].material.transparent, scene.parts[0].material.alpha_mask) == (False, None)
    assert (scene.warnings, scene.notes) == ((), ())


@pytest.mark.parametrize("options", ["", "-s 2 3 1", "-o .25 .5", "-s 2 -o -.5 0 0", "-clamp on", "-clamp on -s -2 .5"])
def test_a_glb_shows_what_the_obj_shows(make, bake, options):
    scene = make(
        f"Kd .5 .25 1\nmap_Kd {options} c.png", {"c.png": rgba(HOLES)}, QUAD.replace("v 1 1 0", "v 1 1 0 1 0 .5")
    )
    path, *_ = bake(scene, "a_ao.glb")
    (ours,), (theirs,) = base_colors(scene)[0], base_colors(load_scene(path))[0]
    assert theirs.factor == pytest.approx(ours.factor)
    assert np.array_equal(ours.texture, theirs.texture)
    assert theirs.uvs == pytest.approx(ours.uvs, abs=1e-6)
    assert theirs.corners == pytest.approx(ours.corners)
    masks = [found.parts[0].material.alpha_mask for found in (scene, load_scene(path))]
    assert masks[1].uvs == pytest.approx(masks[0].uvs, abs=1e-6)
    assert masks[1].wraps == masks[0].wraps


def test_offset_and_scale_move_the_texture(make):
    (color,), _ = base_colors(make("map_Kd -s 2 4 -o .5 .25 c.png", {"c.png": COLORS}))
    assert color.uvs[0].tolist() == [[0.5, 0.25], [3.5, 0.25], [3.5, 4.25]]


# Colours of vertices.


@pytest.mark.parametrize(
    ("rows", "colors"),
    [
        (["1 0 0", "0 .5 0", "0 0 1", "1 1 1"], [(1, 0, 0), (0, 0.5, 0), (0, 0, 1), (1, 1, 1)]),
        (["255 0 0", "0 127.5 0", "0 0 255", "255 255 255"], [(1, 0, 0), (0, 0.5, 0), (0, 0, 1), (1, 1, 1)]),
        (["1 0 0", "", "1", "# 1 2 3"], [(1, 0, 0), (1, 1, 1), (1, 1, 1), (1, 1, 1)]),
        (["1 0 0 1", "0 1 0 .5", "0 0 1 0", ""], [(1, 0, 0, 1), (0, 1, 0, 0.5), (0, 0, 1, 0), (1, 1, 1, 1)]),
    ],
)
def test_colours_of_vertices_reach_the_glb(make, bake, rows, colors):
    lines = QUAD.split("\n")
    text = "\n".join([*(f"{line} {row}" for line, row in zip(lines[:4], rows, strict=True)), *lines[4:]])
    scene = make("Kd 1 1 1", text=text)
    path, *_ = bake(scene, "a_ao.glb")
    json = load_scene(path).document.json
    accessor = json["accessors"][json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    assert accessor["type"] == f"VEC{len(colors[0])}"
    expected = linear_from_srgb(np.array(colors)[:, :3])
    (ours,), (theirs,) = base_colors(scene)[0], base_colors(load_scene(path))[0]
    for corners in (ours.corners, theirs.corners):
        assert corners == pytest.approx(expected[scene.parts[0].vertices])


@pytest.mark.parametrize("rows", [["", "1", "# 1 2 3", ""], ["1 0", "", "", ""]])
def test_weights_and_comments_are_no_colours(make, rows):
    lines = QUAD.split("\n")
    scene = make("", text="\n".join([*(f"{a} {b}" for a, b in zip(lines, rows, strict=False)), *lines[4:]]))
    assert base_colors(scene)[0][0].corners is None


# Pictures that glTF does not hold.


@pytest.mark.parametrize("suffix", ["tga", "bmp", "tif", "webp", "dds", "gif", "png"])
@pytest.mark.parametrize("target", ["a_ao.glb", "a_ao.gltf"])
def test_pictures_of_other_formats_become_png(make, bake, suffix, target):
    flat = np.broadcast_to(np.uint8([10, 200, 30]), (4, 4, 3)) if suffix in ("gif", "webp") else COLORS
    scene = make(f"map_Kd c.{suffix}", {f"c.{suffix}": np.ascontiguousarray(flat)})
    assert output_mesh_extension(scene)[0] == ".glb"
    path, _, _, messages = bake(scene, target)
    assert [f"c.{suffix}" in line and "PNG" in line for line in messages] == [True] * (suffix != "png")
    image = next(
        image for image in load_scene(path).document.json["images"] if "ao" not in image.get("uri", image.get("name"))
    )
    assert image.get("mimeType", "image/png") == "image/png"
    assert picture_of(path)[:, :, :3] == pytest.approx(flat, abs=2)


@pytest.mark.parametrize("suffix", ["tga", "bmp", "tif", "dds"])
def test_alpha_stays(make, bake, suffix):
    path, *_ = bake(make(f"map_Kd c.{suffix}", {f"c.{suffix}": rgba(HOLES)}), "a_ao.glb")
    assert np.array_equal(picture_of(path), rgba(HOLES))
    assert material_of(path)["alphaMode"] == "MASK"


@pytest.mark.parametrize("content", [None, b"", b"\x89PNG\r\n\x1a\n", b"hello", b"\0" * 400])
@pytest.mark.parametrize("suffix", ["png", "tga", "jpg"])
def test_a_picture_that_cannot_be_read_is_named(make, bake, tmp_path, content, suffix):
    if content is not None:
        (tmp_path / f"c.{suffix}").write_bytes(content)
    path, _, _, messages = bake(make(f"map_Kd c.{suffix}"), "a_ao.glb")
    (warning,) = messages
    assert "'leaf' is written without its picture" in warning
    assert f"c.{suffix}" in warning
    assert len(load_scene(path).document.json["images"]) == 1


@needs_validator
def test_the_validator_finds_nothing(make, bake):
    paths = [
        bake(make(mtl, pictures, text), f"{number}_ao.{suffix}")[0]
        for number, (mtl, pictures, text) in enumerate(
            [
                ("d .5\nKd .2 .3 .4", {}, QUAD.replace("v 1 1 0", "v 1 1 0 .2 .3 .4 .5")),
                ("map_Kd -o .5 -s 2 -clamp on c.tga\nmap_d m.png", {"c.tga": COLORS, "m.png": HOLES}, QUAD),
                ("map_Kd c.bmp", {"c.bmp": COLORS}, QUAD),
                ("map_Kd none.png", {}, QUAD),
            ]
        )
        for suffix in ("glb", "gltf")
    ]
    assert [issue for found in issues(*paths) for issue in found if issue["severity"] == ERROR] == []


def test_emission_roughness_and_metalness_reach_the_glb(make, bake):
    path, *_ = bake(make("Ke 1 .5 0\nPr .25 # rough\nPm 2"), "a_ao.glb")
    material = material_of(path)
    assert material["emissiveFactor"] == pytest.approx(linear_from_srgb(np.array([1, 0.5, 0])).tolist())
    assert material["pbrMetallicRoughness"]["roughnessFactor"] == 0.25
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 1


def test_other_textures_and_options_are_named(make, bake):
    mtl = "map_Kd -mm 0 .5 -t 1 1 c.png\nmap_Bump -bm 2 b.png\nnorm n.png\nmap_Ks s.png\nmap_Ka c.png\nKs 1 1 1"
    _, _, _, (warning,) = bake(make(mtl, {"c.png": COLORS}), "a_ao.glb")
    left_out = "-mm of map_Kd c.png, -t of map_Kd c.png, map_Bump b.png, norm n.png, map_Ks s.png"
    assert warning.endswith(f"what else the materials of a.obj have is left out: {left_out}")


def test_textures_without_uvs_are_told(make, bake):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl leaf\nf 1 2 3\n"
    scene = make("map_Kd c.png\nmap_d m.png", {"c.png": COLORS, "m.png": HOLES}, text)
    path, _, _, (warning,) = bake(scene, "a_ao.glb")
    assert "a.obj has no UVs for the textures of its materials (leaf)" in warning
    assert len(load_scene(path).document.json["images"]) == 1


# The bake.


@pytest.mark.parametrize("mtl", ["d .5", "map_d m.png", "map_Kd -s 2 2 c.png", "map_Kd -clamp on -o .25 .5 c.png"])
def test_a_bake_of_the_obj_is_that_of_its_glb(make, bake, mtl):
    roof = "usemtl leaf\nv 0 0 .3\nv 1 0 .3\nv 1 1 .3\nv 0 1 .3\nf 5/1 6/2 7/3 8/4\nusemtl floor\nf 1 2 3 4\n"
    text = "\n".join(line for line in QUAD.splitlines() if line[0] == "v") + f"\n{roof}"
    scene = make(mtl, {"c.png": rgba(HOLES), "m.png": HOLES}, text)
    path, *_ = bake(scene, "a_ao.glb")
    assert [part.name for part in scene.parts] == ["leaf", "floor"]
    options = BakeOptions(directions=64, size=16, backend="ray", only=("floor",), normals="flat", unwrap="xatlas")
    ours, theirs = (aoprecalc.bake(file, options) for file in (scene.path, path))
    assert ours.ao == pytest.approx(theirs.ao, abs=1e-3)
    closed = aoprecalc.bake(make("", {}, text).path, options)
    assert ours.ao[ours.valid].mean() > closed.ao[closed.valid].mean() + 0.05
