"""The options that define a baked value, as they travel with the texture and come back."""

import json
import struct
import zlib

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake import bake_file
from aoprecalc.io import find_occlusion, load_scene, read_image, write_image
from aoprecalc.io.baked_options import bake_text, occlusion_values, options_document, read_options
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.images import MAX_TEXT, png_bytes, read_pixels, read_text
from aoprecalc.options import ValueOptions
from gltf_kit.gltf_validator import needs_validator, new_issues

VALUES = np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8)
OPTIONS = ValueOptions(
    only=("Stühle *", "日本", '"quoted" \\ name'), exclude=("pot",), glass_occludes=True, two_sided=True, ground=True,
    up="z", estimator="mean", normals="flat", crease_angle=30, instances="share", all_parts=True,
)  # fmt: skip
TEXT = bake_text(OPTIONS, 12)


def test_the_text_is_plain_and_gives_the_options_back():
    assert TEXT.isascii()
    assert read_options(TEXT) == read_options(json.loads(TEXT)) == OPTIONS
    assert read_options(bake_text(ValueOptions(), 12)) == ValueOptions()
    assert len(bake_text(ValueOptions(), 12)) < 400


@pytest.mark.parametrize("suffix", [".png", ".exr", ".tif", ".jpg"])
def test_a_picture_carries_the_text_beside_the_same_pixels(tmp_path, suffix):
    for name in "ab":
        write_image(tmp_path / f"{name}{suffix}", VALUES, text=TEXT)
    write_image(tmp_path / f"plain{suffix}", VALUES)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    assert read_text(tmp_path / f"a{suffix}") == TEXT
    assert read_text(tmp_path / f"plain{suffix}") == ""
    np.testing.assert_array_equal(read_pixels(tmp_path / f"a{suffix}"), read_pixels(tmp_path / f"plain{suffix}"))


@pytest.mark.parametrize("suffix", [".tga", ".bmp"])
def test_what_holds_no_text_is_as_before(tmp_path, suffix):
    write_image(tmp_path / f"a{suffix}", VALUES, text=TEXT)
    write_image(tmp_path / f"plain{suffix}", VALUES)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"plain{suffix}").read_bytes()
    assert read_text(tmp_path / f"a{suffix}") == ""


def test_pillow_reads_the_text_and_may_write_it(tmp_path):
    from PIL import Image, PngImagePlugin

    write_image(tmp_path / "a.png", VALUES, text=TEXT)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.text == {"aoprecalc": TEXT}
        info = PngImagePlugin.PngInfo()
        info.add_text("aoprecalc", picture.text["aoprecalc"], zip=True)
        picture.save(tmp_path / "again.png", pnginfo=info)
    assert read_text(tmp_path / "again.png") == TEXT
    write_image(tmp_path / "a.tif", VALUES, text=TEXT)
    with Image.open(tmp_path / "a.tif") as picture:
        assert picture.tag_v2[270] == f"aoprecalc {TEXT}"


@pytest.mark.parametrize("kind", ["glb", "gltf"])
@pytest.mark.parametrize("texture", ["a.png", "a.tga"])
def test_gltf_has_them_in_extras(gltf_cube, tmp_path, kind, texture):
    import pygltflib

    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive))
    result = bake_file(
        maker.save("cube.glb"),
        tmp_path / texture,
        mesh_output=tmp_path / f"a.{kind}",
        options=ao.BakeOptions(size=32, directions=64, backend="ray", ground=True),
    )
    document = pygltflib.GLTF2().load(result.files.mesh)
    (said,) = (material.occlusionTexture.extras["aoprecalc"] for material in document.materials)
    assert read_options(said) == result.report.options == ValueOptions(ground=True, up="y")
    scene = load_scene(result.files.mesh)
    found = find_occlusion(scene)
    assert (found.options, found.warnings) == (result.report.options, ())
    assert find_occlusion(scene, result.files.texture).options == (None if texture == "a.tga" else found.options)


@needs_validator
@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_the_validator_of_khronos_accepts_them(gltf_cube, tmp_path, kind):
    maker, primitive = gltf_cube
    maker.node(mesh=maker.mesh(primitive))
    options = ao.BakeOptions(size=32, directions=64, backend="ray", ground=True)
    path = maker.save("cube.glb")
    result = bake_file(path, tmp_path / "a.png", mesh_output=tmp_path / f"a.{kind}", options=options)
    assert new_issues(path, result.files.mesh) == []


@pytest.mark.parametrize(
    ("before", "kept"),
    [
        ({"artist": "Ada", "aoprecalc": {"schema": 1, "ground": True}}, {"artist": "Ada"}),
        (["of", "any", "type"], None),
        ({}, {}),
    ],
)
def test_what_a_user_has_in_extras_is_kept(gltf_cube, tmp_path, before, kept):
    maker, primitive = gltf_cube
    info = {"index": maker.texture(VALUES * 255), "extras": before}
    primitive["material"] = maker.add("materials", {"occlusionTexture": info, "extras": {"of": "the material"}})
    maker.node(mesh=maker.mesh(primitive))
    options = ao.BakeOptions(size=32, directions=64, backend="ray")
    files = bake_file(maker.save("cube.gltf"), tmp_path / "a.png", mesh_output=tmp_path / "a.gltf", options=options)
    (material,) = json.loads(files.files.mesh.read_text())["materials"]
    own = {"aoprecalc": json.loads(json.dumps(options_document(ValueOptions())))}
    assert material["occlusionTexture"]["extras"] == (before if kept is None else kept | own)
    assert material["extras"] == {"of": "the material"}


DAMAGED = {
    "nothing": "",
    "no JSON": "{",
    "a list": "[1, 2]",
    "another schema": '{"schema": 2}',
    "a wrong value": '{"schema": 1, "ground": 3}',
    "a wrong choice": '{"schema": 1, "estimator": "median"}',
    "a contradiction": '{"schema": 1, "up": "z"}',
    "an angle out of range": '{"schema": 1, "crease_angle": 999}',
    "too deep": "[" * 10_000,
    "too long": '{"schema": 1, "only": ["' + "x" * MAX_TEXT + '"]}',
    "a number without end": "9" * 10_000,
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_damaged_text_is_a_warning(case, tmp_path):
    with pytest.raises(ValueError, match=r"\S"):
        read_options(DAMAGED[case])
    if not DAMAGED[case]:
        return
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    write_image(tmp_path / "a.png", VALUES, text=DAMAGED[case])
    report = ao.verify(tmp_path / "a.obj", options=ao.VerifyOptions(points=10, rays=64))
    (line,) = report.warnings
    assert line.startswith(f"{tmp_path / 'a.png'}: the options of its bake cannot be read (")
    assert len(line.splitlines()) == 1
    assert len(line) < len(str(tmp_path)) + 250
    assert (report.options, report.options_from) == (ValueOptions(), None)


def test_a_chunk_that_is_no_text_is_a_picture_without_one(tmp_path):
    data = png_bytes(VALUES)
    for keyword, content in ((b"aoprecalc\0", b"\xff\xfe\0\x80"), (b"aoprecalc\0", b""), (b"Comment\0", b"{}")):
        chunk = b"tEXt" + keyword + content
        chunk = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        (tmp_path / "a.png").write_bytes(data[:33] + chunk + data[33:])
        with pytest.raises(ValueError, match=r"\S"):
            read_options(read_text(tmp_path / "a.png"))
        assert np.abs(read_image(tmp_path / "a.png") - VALUES).max() < 1 / 255


def test_an_image_of_the_complement_is_read_as_the_values(tmp_path):
    text = bake_text(OPTIONS, 12, inverted=True)
    assert read_options(text) == OPTIONS
    write_image(tmp_path / "a.exr", 1 - VALUES, "float", text)
    write_image(tmp_path / "b.exr", VALUES, "float", TEXT)
    for name in "ab":
        found = occlusion_values(ImageSource.of(tmp_path / f"{name}.exr"))
        np.testing.assert_allclose(found, VALUES, atol=1e-7)
    write_image(tmp_path / "c.exr", VALUES, "float", '{"schema": 1, "inverted": "yes"}')
    np.testing.assert_array_equal(occlusion_values(ImageSource.of(tmp_path / "c.exr")), VALUES)


def test_a_very_long_list_of_names_does_not_travel():
    names = tuple(f"part {number}" for number in range(5000))
    assert bake_text(ValueOptions(only=names), 12) == ""


def test_equal_bakes_by_other_paths_have_equal_bytes(tmp_path):
    shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    options = ao.BakeOptions(size=32, directions=64, backend="ray")
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.obj").write_text(shape)
        bake_file(tmp_path / folder / "a.obj", tmp_path / folder / "out.png", options=options)
    one, two = ((tmp_path / folder / "out.png").read_bytes() for folder in ("one", "two"))
    assert one == two
    assert str(tmp_path).encode() not in one
