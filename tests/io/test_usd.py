"""USD stages: what usd-core composes is what is baked, and damage is one line."""

import re
import sys

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.io.meshes import base_colors, input_files, source_files
from aoprecalc.mesh.roles import up_axis
from aoprecalc.mesh.surface import face_normals
from aoprecalc.options import BakeOptions
from aoprecalc.pipeline.state import InputFiles
from usd_stages import PLAIN, QUAD, SIDES, add_material, add_mesh, add_uvs, bind


@pytest.fixture
def stage(tmp_path):
    return Usd.Stage.CreateNew(str(tmp_path / "a.usda"))


def saved(stage):
    stage.GetRootLayer().Save()
    return load_scene(stage.GetRootLayer().realPath)


def faces_outwards(scene, part):
    corners = scene.corners[part.faces]
    outwards = corners.mean(axis=1) - corners.reshape(-1, 3).mean(axis=0)
    return (np.einsum("ij,ij->i", face_normals(corners)[0], outwards) > 0).all()


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
@pytest.mark.parametrize("scale", [(2, 1, 1), (-2, 1, 1)], ids=["as it is", "mirrored"])
def test_a_mesh_is_placed_in_the_world_and_faces_outwards(stage, scale, orientation):
    group = UsdGeom.Xform.Define(stage, "/group")
    group.AddTranslateOp().Set((5e5, 0.125, 0))
    faces = SIDES if orientation == "rightHanded" else [face[::-1] for face in SIDES]
    mesh = add_mesh(stage, "/group/box", faces=faces)
    mesh.AddScaleOp().Set(scale)
    mesh.GetOrientationAttr().Set(orientation)
    scene = saved(stage)
    assert scene.positions.min(axis=0).tolist() == [5e5 - 2, -0.875, -1]
    assert scene.positions.max(axis=0).tolist() == [5e5 + 2, 1.125, 1]
    assert [part.name for part in scene.parts] == ["box"]
    assert {"group", "box", "/group/box"} <= scene.parts[0].names
    assert faces_outwards(scene, scene.parts[0])


@pytest.mark.parametrize(("axis", "up"), [("Y", "y"), ("Z", "z")])
def test_the_stage_says_what_is_up(stage, axis, up):
    UsdGeom.SetStageUpAxis(stage, axis)
    UsdGeom.SetStageMetersPerUnit(stage, 0.001)
    add_mesh(stage, "/box")
    assert saved(stage).unit == 0.001
    assert up_axis(saved(stage), BakeOptions(ground=True)) == up
    assert up_axis(saved(stage), BakeOptions(ground=True, up="x")) == "x"


@pytest.mark.parametrize("extension", [".usd", ".usda", ".usdc", ".usdz"])
def test_every_kind_of_file_holds_the_same(stage, tmp_path, extension):
    add_uvs(add_mesh(stage, "/box"), "st", [(0, 0), (1, 0), (1, 1), (0, 1)], indices=[0, 1, 2, 3] * 6)
    expected, path = saved(stage), tmp_path / f"b{extension}"
    if extension == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(stage.GetRootLayer().realPath, str(path))
    else:
        stage.GetRootLayer().Export(str(path))
    scene = load_scene(path)
    assert scene.format == extension[1:]
    assert np.array_equal(scene.corners, expected.corners)
    assert np.array_equal(scene.uvs, expected.uvs)


@pytest.mark.parametrize(
    ("interpolation", "count"), [("vertex", 6), ("varying", 6), ("faceVarying", 8), ("uniform", 2), ("constant", 1)]
)
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_values_reach_the_corners_that_they_belong_to(stage, interpolation, count, orientation):
    points, faces = [*QUAD, (4, 0, 0), (4, 2, 0)], [[0, 1, 2, 3], [1, 4, 5, 2]]
    mesh = add_mesh(stage, "/quads", points, faces)
    mesh.GetOrientationAttr().Set(orientation)
    values = [(n / 10, n / 20) for n in range(count)]
    add_uvs(mesh, "st", values, interpolation)
    mesh.GetNormalsAttr().Set([Gf.Vec3f(1, n, 2) for n in range(count)])
    mesh.SetNormalsInterpolation(interpolation)
    scene = saved(stage)
    places = np.array(points, float)
    for (face, corner), position in np.ndenumerate(np.arange(4 * 3).reshape(4, 3)):
        at = scene.corners[face, corner]
        vertex = int(np.flatnonzero((places == at).all(axis=1))[0])
        polygon = face // 2
        number = {
            "uniform": polygon,
            "constant": 0,
            "faceVarying": 4 * polygon + faces[polygon].index(vertex),
        }.get(interpolation, vertex)
        assert scene.uvs[face, corner] == pytest.approx(values[number]), position
        assert np.cross(scene.normals[face, corner], (1, number, 2)) == pytest.approx(0, abs=1e-6)


def test_normals_stand_on_the_surface_of_a_stretched_mesh(stage):
    mesh = add_mesh(stage, "/slope", [(0, 0, 0), (1, 0, 1), (0, 1, 0)], [[0, 1, 2]])
    mesh.AddScaleOp().Set((3, 1, -1))
    mesh.GetNormalsAttr().Set([(-1, 0, 1)] * 3)
    scene = saved(stage)
    expected = np.array([-1 / 3, 0, -1]) / np.hypot(1 / 3, 1)
    assert scene.normals.reshape(-1, 3) == pytest.approx(np.tile(expected, (3, 1)))


def test_subsets_are_parts_by_material(stage):
    mesh = add_mesh(stage, "/box")
    add_uvs(mesh, "st", [(0, 0), (1, 0), (1, 1), (0, 1)], indices=[0, 1, 2, 3] * 6)
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("lid", [1, 3])
    bind(subset, add_material(stage, "/glass", opacity=0.5))
    bind(mesh, add_material(stage, "/stone"))
    scene = saved(stage)
    assert [(part.name, part.stop - part.start) for part in scene.parts] == [("box", 8), ("box/lid", 4)]
    assert [part.material.transparent for part in scene.parts] == [False, True]
    assert "stone" in scene.parts[0].names
    assert {"glass", "box"} <= scene.parts[1].names


def test_instances_are_parts_where_they_are_placed(stage):
    add_mesh(stage, "/class/box")
    stage.GetPrimAtPath("/class").SetSpecifier(Sdf.SpecifierClass)
    for number in range(3):
        copy = UsdGeom.Xform.Define(stage, f"/copy{number}")
        copy.AddTranslateOp().Set((10 * number, 0, 0))
        copy.GetPrim().GetReferences().AddInternalReference("/class")
        copy.GetPrim().SetInstanceable(True)
    scene = saved(stage)
    assert len(scene.parts) == 3
    centers = [scene.corners[part.faces].reshape(-1, 3).mean(axis=0)[0] for part in scene.parts]
    assert centers == pytest.approx([0, 10, 20])


def test_what_is_not_shown_is_left_out_and_told(stage):
    for name in "abcd":
        add_mesh(stage, f"/{name}", scheme=None if name == "a" else PLAIN)
    UsdGeom.Imageable(stage.GetPrimAtPath("/b")).MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/c")).GetPurposeAttr().Set("proxy")
    stage.GetPrimAtPath("/d").SetActive(False)
    UsdGeom.Sphere.Define(stage, "/ball")
    UsdGeom.Camera.Define(stage, "/eye")
    for name in ("sun", "moon"):
        UsdLux.DistantLight.Define(stage, f"/{name}")
    instancer = UsdGeom.PointInstancer.Define(stage, "/trees")
    add_mesh(stage, "/trees/tree")
    instancer.CreatePrototypesRel().AddTarget("/trees/tree")
    scene = saved(stage)
    assert [part.name for part in scene.parts] == ["a"]
    assert scene.notes == (
        "1 invisible mesh left out",
        "1 mesh of the purpose guide or proxy left out",
        "1 subdivision surface is read as the control cage",
    )
    assert len(scene.warnings) == 1
    assert "not 1 Camera, 2 DistantLight, 1 Sphere;" in scene.warnings[0]


@pytest.mark.parametrize(
    ("inputs", "transparent"),
    [({}, False), ({"opacity": 0.5}, True), ({"opacity": 0.5, "opacityThreshold": 0.1}, False)],
)
def test_opacity_lets_light_through(stage, inputs, transparent):
    bind(add_mesh(stage, "/box"), add_material(stage, "/look", **inputs))
    assert saved(stage).parts[0].material.transparent is transparent


@pytest.mark.parametrize("channel", ["a", "r"])
def test_a_texture_with_a_threshold_is_a_mask(stage, tmp_path, channel):
    holes = np.array([[0, 255], [255, 255]], np.uint8)
    bands = [holes] * 4 if channel == "r" else [255 - holes] * 3 + [holes]
    Image.merge("RGBA", [Image.fromarray(band) for band in bands]).save(tmp_path / "leaf.png")
    mesh = add_mesh(stage, "/card", QUAD, [[0, 1, 2, 3]])
    add_uvs(mesh, "st", [(0, 0), (1, 0), (1, 1), (0, 1)])
    mesh.GetDoubleSidedAttr().Set(True)
    bind(mesh, add_material(stage, "/look", "./leaf.png", channel, opacityThreshold=0.25))
    scene = saved(stage)
    material = scene.parts[0].material
    assert material.foliage
    assert material.alpha_mask.cutoff == 0.25
    assert material.alpha_mask.alpha.tolist() == [[0, 1], [1, 1]]
    assert np.array_equal(material.alpha_mask.uvs, scene.uvs)
    assert source_files(scene) == [scene.path, tmp_path / "leaf.png"]
    assert input_files(scene.path, scene.path.read_bytes()) == source_files(scene)


def test_a_missing_reference_is_told_and_the_rest_is_read(stage):
    add_mesh(stage, "/box")
    stage.DefinePrim("/lost").GetReferences().AddReference("./lost.usda")
    scene = saved(stage)
    assert [part.name for part in scene.parts] == ["box"]
    assert "lost.usda" in scene.warnings[0]


@pytest.mark.slow
def test_nested_instances_without_end_are_refused(stage):
    add_mesh(stage, "/level0/box")
    for level in range(1, 9):
        for number in range(10):
            prim = UsdGeom.Xform.Define(stage, f"/level{level}/copy{number}").GetPrim()
            prim.GetReferences().AddInternalReference(f"/level{level - 1}")
            prim.SetInstanceable(True)
    with pytest.raises(InputError, match="use a smaller scene"):
        saved(stage)


def test_a_glb_gets_the_numbers_of_the_materials(stage):
    look = add_material(stage, "/look", diffuseColor=(0.5, 0.0, 1.0), roughness=0.25, metallic=1.0, opacity=0.5)
    bind(add_mesh(stage, "/box"), look)
    material = saved(stage).document.materials["look"]
    assert material.factor(textured=False) == pytest.approx((0.5, 0, 1), abs=1e-6)
    assert (material.roughness, material.metalness, material.opacity) == (0.25, 1, 0.5)
    assert material.alpha_mode == "BLEND"


@pytest.mark.parametrize(
    ("name", "value", "factor", "told"),
    [
        ("scale", (0.5, 1, 0.25, 1), (0.5, 1, 0.25), []),
        ("scale", (2, 1, 1, 1), (1, 1, 1), ["look"]),
        ("bias", (0.5, 0, 0, 0), (1, 1, 1), ["look"]),
    ],
)
def test_a_scale_multiplies_the_texture_and_what_cannot_be_kept_is_told(stage, tmp_path, name, value, factor, told):
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "wood.png")
    mesh = add_mesh(stage, "/card", QUAD, [[0, 1, 2, 3]])
    add_uvs(mesh, "st", [(0, 0), (1, 0), (1, 1), (0, 1)])
    bind(mesh, add_material(stage, "/look", "./wood.png", "rgb", "diffuseColor"))
    texture = UsdShade.Shader(stage.GetPrimAtPath("/look/texture"))
    texture.CreateInput(name, Sdf.ValueTypeNames.Float4).Set(value)
    scene = saved(stage)
    assert scene.document.materials["look"].factor(textured=True) == pytest.approx(factor, abs=1e-6)
    assert base_colors(scene)[0][0].factor == factor
    assert [
        re.findall("scale and bias of colour textures are ignored in (.*);", line)[0] for line in scene.warnings
    ] == told


@pytest.mark.parametrize("context", ["mtlx", "mdl", ""])
def test_materials_of_other_kinds_are_told(stage, context):
    material = UsdShade.Material.Define(stage, "/looks/oak")
    shader = UsdShade.Shader.Define(stage, "/looks/oak/surface")
    shader.CreateIdAttr("ND_standard_surface_surfaceshader")
    material.CreateSurfaceOutput(context).ConnectToSource(shader.ConnectableAPI(), "surface")
    bind(add_mesh(stage, "/box"), material)
    bind(add_mesh(stage, "/bare"), UsdShade.Material.Define(stage, "/looks/bare"))
    (line,) = saved(stage).warnings
    assert "read as opaque and white: oak;" in line


HEAD = "#usda 1.0\n"
TRIANGLE = """def Mesh "m" {{
    point3f[] points = [{points}]
    int[] faceVertexCounts = [{counts}]
    int[] faceVertexIndices = [{indices}]
}}
"""


def triangle(points="(0,0,0), (1,0,0), (0,1,0)", counts="3", indices="0, 1, 2"):
    return HEAD + TRIANGLE.format(points=points, counts=counts, indices=indices)


DAMAGED = {
    "empty stage": (HEAD, "no faces found"),
    "only words": ("garbage", "not a valid usda layer"),
    "cut": (triangle()[:60], "cannot be read as USD"),
    "no number": (triangle("(nan,0,0), (1,0,0), (0,1,0)"), "not finite"),
    "infinite": (triangle("(inf,0,0), (1,0,0), (0,1,0)"), "not finite"),
    "beyond": (triangle(indices="0, 1, 3"), "refers to point 3, but there are 3"),
    "negative": (triangle(indices="0, -1, 2"), "refers to point -1"),
    "more corners": (triangle(counts="4"), "has 3 face vertex indices, 4 were expected"),
    "negative count": (triangle(counts="-3, 6"), "has 3 face vertex indices"),
    "flat": (triangle("(0,0,0), (1,0,0), (2,0,0)"), "none of 1 face has any area"),
    "missing reference": (HEAD + 'def "a" (references = @./b.usda@) {}', "b.usda"),
    "itself": (HEAD + 'def "a" (references = </a>) {}', "Cycle"),
    "in a circle": (HEAD + 'def "a" (references = </b>) {}\ndef "b" (references = </a>) {}', "Cycle"),
    "its own layer": (HEAD.strip() + "\n(subLayers = [@./a.usda@])\n", "ycle"),
}


@pytest.mark.parametrize(("text", "found"), DAMAGED.values(), ids=DAMAGED)
def test_damage_is_one_line(tmp_path, capfd, text, found):
    path = tmp_path / "a.usda"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(found)) as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_a_cut_binary_stage_is_told(stage, tmp_path, share):
    add_mesh(stage, "/box")
    stage.GetRootLayer().Export(str(tmp_path / "b.usdc"))
    data = (tmp_path / "b.usdc").read_bytes()
    (tmp_path / "c.usdc").write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"c\.usdc: .*; the file is damaged, export it again$"):
        load_scene(tmp_path / "c.usdc")


CHILDREN = {
    "dies": ("import os; os.abort()", r"USD could not read it \(signal 6"),
    "hangs": ("import time; time.sleep(60)", r"USD gave no answer within 1 s"),
}
LAYERS = {"b.usdc": b"PXR-USDC", "wrap.usda": b'#usda 1.0\ndef "a" (references = @./b.usdc@</a>) {}'}


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize(("program", "found"), CHILDREN.values(), ids=CHILDREN)
def test_a_layer_that_ends_or_stops_usd_does_so_in_a_child(tmp_path, capfd, monkeypatch, name, program, found):
    monkeypatch.setattr("aoprecalc.io.formats.library_process.LibraryProcess.command", [sys.executable, "-c", program])
    monkeypatch.setattr("aoprecalc.io.formats.library_process._SECONDS", 0.6)
    (tmp_path / name).write_bytes(LAYERS[name])
    assert list(InputFiles.of(tmp_path / name).files) == [name]
    with pytest.raises(InputError, match=found):
        load_scene(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_the_files_of_a_stage_are_found_whatever_their_kind(stage, tmp_path, capfd):
    add_mesh(stage, "/box")
    stage.GetRootLayer().Export(str(tmp_path / "b.usdc"))
    (tmp_path / "wrap.usda").write_bytes(LAYERS["wrap.usda"].replace(b"</a>", b"</box>"))
    binary = Usd.Stage.CreateNew(str(tmp_path / "top.usdc"))
    binary.DefinePrim("/a").GetReferences().AddReference("./wrap.usda", "/a")
    binary.DefinePrim("/b").GetReferences().AddReference("./lost.usda")
    binary.GetRootLayer().Save()
    capfd.readouterr()
    expected = {"top.usdc", "wrap.usda", "b.usdc", "lost.usda"}
    assert {path.name for path in input_files(tmp_path / "top.usdc", b"PXR-USDC")} == expected
    assert {path.name for path in source_files(load_scene(tmp_path / "top.usdc"))} == expected
    assert capfd.readouterr() == ("", "")


def test_a_package_without_meshes_is_told(stage, tmp_path):
    UsdGeom.Sphere.Define(stage, "/ball")
    stage.GetRootLayer().Save()
    UsdUtils.CreateNewUsdzPackage(stage.GetRootLayer().realPath, str(tmp_path / "b.usdz"))
    with pytest.raises(InputError, match=r"no mesh is shown.* not 1 Sphere"):
        load_scene(tmp_path / "b.usdz")


def test_what_is_missing_is_named(stage, monkeypatch):
    add_mesh(stage, "/box")
    monkeypatch.setattr("aoprecalc.io.formats.usd.find_spec", lambda name: None)
    with pytest.raises(InputError, match=re.escape("`pip install 'aoprecalc[usd]'`")):
        saved(stage)
