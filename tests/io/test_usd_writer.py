"""USD stages with occlusion: pxr finds the texture on the corners that it belongs to, and everything else as it was."""

import json
import re
import shutil
from pathlib import Path
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, UsdValidation

from aoprecalc.errors import UsageError
from aoprecalc.io import load_scene, output_mesh_extension
from aoprecalc.io.formats.textures import output_uvs
from aoprecalc.io.occlusion import every_occlusion, find_occlusion
from aoprecalc.options import ValueOptions
from usd_stages import CORNERS, QUAD, SIDES, SQUARE, add_material, add_mesh, add_uvs, bind, write_baked


@pytest.fixture
def stage(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    return stage


def saved(stage, suffix=".usda"):
    """The path of a stage in another kind of file; the inner kind of .usd is binary."""
    stage.GetRootLayer().Save()
    source = stage.GetRootLayer().realPath
    target = source.replace(".usda", suffix)
    if suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(source, target)
    elif suffix != ".usda":
        stage.GetRootLayer().Export(target)
    return Path(target)


@pytest.fixture
def prim_at():
    """prim_at(path of a file, path): a prim, whose stage stays open."""
    opened = {}

    def find(file, path):
        return opened.setdefault(file, Usd.Stage.Open(str(file))).GetPrimAtPath(path)

    return find


def occlusion_texture(owner):
    """The shaders of the texture and of its UVs that the material of a prim has for its occlusion."""
    material = UsdShade.MaterialBindingAPI(owner).ComputeBoundMaterial()[0]
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetShaderId() == "UsdPreviewSurface"
    source, output, _ = surface.GetInput("occlusion").GetConnectedSource()
    assert output == "r"
    texture = UsdShade.Shader(source.GetPrim())
    assert texture.GetShaderId() == "UsdUVTexture"
    assert texture.GetInput("sourceColorSpace").Get() == "raw"
    assert texture.GetInput("fallback").Get() == (1, 1, 1, 1)
    reader = UsdShade.Shader(texture.GetInput("st").GetConnectedSource()[0].GetPrim())
    assert reader.GetShaderId() == "UsdPrimvarReader_float2"
    return texture, reader


def shown_uvs(prim, owner=None):
    """The UVs of the occlusion at each face corner of a Mesh, as a renderer finds them."""
    reader = occlusion_texture(owner or prim)[1]
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(reader.GetInput("varname").Get())
    assert primvar.GetTypeName() == Sdf.ValueTypeNames.TexCoord2fArray
    values = np.array(primvar.ComputeFlattened())
    if primvar.GetInterpolation() == "faceVarying":
        return values
    return values[np.array(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get())]


def expected_uvs(scene, atlas, part, corners):
    """The UVs of the atlas at each face corner of the Mesh of a part; NaN where it has none."""
    uvs = np.full((corners, 2), np.nan)
    uvs[part.source.corners[part.source.polygons.triangles]] = output_uvs(scene, atlas)[part.faces]
    return uvs


def authored(path):
    """Everything that a stage states: prim path and property -> its value, by time where that has samples."""
    stage = Usd.Stage.Open(str(path))
    found = {}
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
        found[str(prim.GetPath())] = prim.GetTypeName(), str(prim.GetMetadata("kind"))
        for relationship in prim.GetAuthoredRelationships():
            found[str(relationship.GetPath())] = list(map(str, relationship.GetTargets()))
        for attribute in prim.GetAuthoredAttributes():
            times = attribute.GetTimeSamples() or [Usd.TimeCode.Default()]
            values = [str(attribute.Get(time)) for time in times]
            connections = list(map(str, attribute.GetConnections()))
            metadata = {key: str(value) for key, value in attribute.GetAllAuthoredMetadata().items()}
            found[str(attribute.GetPath())] = list(map(str, times)), values, connections, metadata
    layer = stage.GetRootLayer()
    found["stage"] = {key: str(layer.pseudoRoot.GetInfo(key)) for key in layer.pseudoRoot.ListInfoKeys()}
    return found


def assert_the_rest_is_the_same(source, target, *but):
    before, after = authored(source), authored(target)
    changed = {key for key, value in before.items() if after.get(key) != value}
    assert changed == set(but)


def complaints(path):
    """What the validators of USD find."""
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    errors = context.Validate(Usd.Stage.Open(str(path)))
    return {str(error.GetIdentifier()) for error in errors}


SUFFIXES = [".usd", ".usda", ".usdc", ".usdz"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_renderer_finds_the_texture_and_everything_else_as_it_was(stage, prim_at, tmp_path, suffix):
    """Mesh with UVs and a picture, animated; a group that is turned; a light."""
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "wood.png")
    group = UsdGeom.Xform.Define(stage, "/group")
    group.AddRotateXOp().Set(30.0)
    stage.SetDefaultPrim(group.GetPrim())
    group.GetPrim().SetMetadata("kind", "component")
    mesh = add_mesh(stage, "/group/box")
    mesh.AddTranslateOp().Set((0, 0, 0), 1)
    mesh.GetPrim().GetAttribute("xformOp:translate").Set((9, 0, 0), 5)
    add_uvs(mesh, "st", SQUARE, indices=[0, 1, 2, 3] * 6)
    mesh.GetNormalsAttr().Set([Gf.Vec3f(*point) for point in CORNERS])
    bind(mesh, add_material(stage, "/group/looks/wood", "./wood.png", "rgb", "diffuseColor", roughness=0.25))
    UsdGeom.Camera.Define(stage, "/group/eye")
    source, target = saved(stage, suffix), tmp_path / f"a_ao{suffix}"
    before = complaints(source)

    scene, atlas, written = write_baked(source, target)
    prim = prim_at(target, "/group/box")
    assert shown_uvs(prim) == pytest.approx(expected_uvs(scene, atlas, scene.parts[0], 24), abs=1e-6)
    assert [(use.slot, use.uvs, use.materials) for use in written.references] == [
        ("inputs:occlusion", "primvars:st1", 1)
    ]
    assert written.messages == ()
    assert_the_rest_is_the_same(source, target)
    assert complaints(target) <= before
    back = load_scene(target)
    picture = find_occlusion(back)
    assert picture.values == pytest.approx(np.linspace(0, 1, 64).reshape(8, 8), abs=1 / 255)
    assert picture.uvs == pytest.approx(atlas.uvs, abs=1e-6)
    assert picture.options == ValueOptions()
    assert np.array_equal(back.normals, scene.normals)
    kinds = {".usd": b"PXR-USDC", ".usda": b"#usda", ".usdc": b"PXR-USDC", ".usdz": b"PK"}
    assert target.read_bytes().startswith(kinds[suffix])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_stage_gives_the_same_bytes(stage, tmp_path, suffix):
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood"))
    bind(add_mesh(stage, "/other"), add_material(stage, "/looks/stone"))
    source = saved(stage, suffix)
    targets = [tmp_path / folder / f"a_ao{suffix}" for folder in "bc"]
    for target in targets:
        write_baked(source, target)
    assert targets[0].read_bytes() == targets[1].read_bytes()


def test_a_text_layer_in_a_usd_stays_text(stage, tmp_path):
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood"))
    shutil.copy(saved(stage), tmp_path / "b.usd")
    write_baked(tmp_path / "b.usd", tmp_path / "b_ao.usd")
    assert (tmp_path / "b_ao.usd").read_bytes().startswith(b"#usda")


def test_a_package_can_be_mapped_and_holds_the_texture(stage, tmp_path):
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "wood.png")
    mesh = add_mesh(stage, "/box")
    add_uvs(mesh, "st", SQUARE, indices=[0, 1, 2, 3] * 6)
    bind(mesh, add_material(stage, "/looks/wood", "./wood.png", "rgb", "diffuseColor"))
    source, target = saved(stage, ".usdz"), tmp_path / "a_ao.usdz"
    write_baked(source, target)
    data = target.read_bytes()
    with ZipFile(source) as before, ZipFile(target) as after:
        assert after.testzip() is None
        assert [entry.filename for entry in after.infolist()] == [*before.namelist(), "a_ao.png"]
        for entry in after.infolist():
            assert entry.compress_type == ZIP_STORED
            start = (
                entry.header_offset
                + 30
                + sum(
                    int.from_bytes(data[entry.header_offset + at : entry.header_offset + at + 2], "little")
                    for at in (26, 28)
                )
            )
            assert start % 64 == 0
            assert data[start : start + entry.file_size] == after.read(entry)
        assert after.read("a_ao.png") == (tmp_path / "a_ao.png").read_bytes()
        for name in before.namelist()[1:]:
            assert after.read(name) == before.read(name)
    (tmp_path / "a_ao.png").unlink()
    assert find_occlusion(load_scene(target)).values.shape == (8, 8)


@pytest.mark.parametrize("texture", ["x.tif", "x.exr"])
def test_a_package_holds_pictures_of_its_kinds(stage, tmp_path, texture):
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood"))
    _, _, written = write_baked(saved(stage, ".usdz"), tmp_path / "a_ao.usdz", texture=tmp_path / texture)
    expected = "x.png" if texture == "x.tif" else texture
    assert expected in ZipFile(tmp_path / "a_ao.usdz").namelist()
    assert len(written.messages) == (texture == "x.tif")


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
@pytest.mark.parametrize("scale", [(2, 1, 1), (-2, 1, 1)], ids=["as it is", "mirrored"])
def test_uvs_are_at_the_right_corners_whatever_the_winding(stage, prim_at, tmp_path, scale, orientation):
    points = [*QUAD, (4, 0, 0), (5, 1, 0), (4, 2, 0), (9, 9, 9)]
    mesh = add_mesh(stage, "/faces", points, [[0, 1, 2, 3], [1, 4, 5, 6, 2], [0, 1, 7]])
    mesh.GetOrientationAttr().Set(orientation)
    mesh.AddScaleOp().Set(scale)
    bind(mesh, add_material(stage, "/looks/wood"))
    scene, atlas, written = write_baked(saved(stage), tmp_path / "a_ao.usda")
    prim = prim_at(tmp_path / "a_ao.usda", "/faces")
    uvs, vertices = shown_uvs(prim), np.array(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get())
    places = np.array(points, float) * scale
    for face, corners in enumerate(scene.corners):
        polygon = scene.parts[0].source.polygons.owners[face]
        for position, uv in zip(corners, atlas.uvs[face], strict=True):
            at = slice(*[(0, 4), (4, 9), (9, 12)][polygon])
            found = uvs[at][(places[vertices[at]] == position).all(axis=1)]
            assert found == pytest.approx(uv[None], abs=1e-6)
    assert not any("polygon" in line for line in written.messages)


def test_new_normals_are_those_that_were_used(stage, tmp_path):
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood"))
    stage.GetPrimAtPath("/box").GetAttribute("orientation").Set("leftHanded")
    UsdGeom.Xformable(stage.GetPrimAtPath("/box")).AddScaleOp().Set((3, 1, -1))
    source = saved(stage)
    corners = load_scene(source).corners
    normals = (corners / np.linalg.norm(corners, axis=2, keepdims=True)).astype(np.float32)
    write_baked(source, tmp_path / "a_ao.usda", normals=normals)
    assert load_scene(tmp_path / "a_ao.usda").normals == pytest.approx(normals, abs=1e-6)


@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_normals_replace_those_of_the_file_where_a_renderer_looks(stage, tmp_path, name):
    mesh = add_mesh(stage, "/box")
    if name == "normals":
        mesh.GetNormalsAttr().Set([(1, 0, 0)] * 8)
    else:
        kind = Sdf.ValueTypeNames.Normal3fArray
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", kind, "vertex")
        primvar.Set([(1, 0, 0), (0, 1, 0)])
        primvar.SetIndices([0, 1] * 4)
    bind(mesh, add_material(stage, "/looks/wood"))
    normals = np.tile(np.float32([0, 0.6, 0.8]), (12, 3, 1))
    write_baked(saved(stage), tmp_path / "a_ao.usda", normals=normals)
    assert load_scene(tmp_path / "a_ao.usda").normals == pytest.approx(normals, abs=1e-6)


def test_a_subdivision_surface_gets_no_normals(stage, tmp_path):
    bind(add_mesh(stage, "/box", scheme=None), add_material(stage, "/looks/wood"))
    source = saved(stage)
    write_baked(source, tmp_path / "a_ao.usda")
    assert load_scene(tmp_path / "a_ao.usda").normals is None
    assert_the_rest_is_the_same(source, tmp_path / "a_ao.usda")


def test_kept_uvs_are_read_under_their_name(stage, tmp_path):
    first, second = add_mesh(stage, "/first", QUAD, [[0, 1, 2, 3]]), add_mesh(stage, "/second", QUAD, [[0, 1, 2, 3]])
    material = add_material(stage, "/looks/wood")
    for mesh, name in ((first, "st"), (second, "UVMap")):
        add_uvs(mesh, name, SQUARE, "vertex")
        bind(mesh, material)
    source, target = saved(stage), tmp_path / "a_ao.usda"
    _, _, written = write_baked(source, target, keep=True)
    baked = Usd.Stage.Open(str(target))
    for path, name in (("/first", "st"), ("/second", "UVMap")):
        prim = baked.GetPrimAtPath(path)
        assert occlusion_texture(prim)[1].GetInput("varname").Get() == name
        assert shown_uvs(prim).tolist() == [list(uv) for uv in SQUARE]
    assert [(use.uvs, use.materials) for use in written.references] == [("primvars:st", 1), ("primvars:UVMap", 1)]
    assert_the_rest_is_the_same(source, target, "/second.material:binding")
    assert len(every_occlusion(load_scene(target))) == 1


def test_what_is_not_baked_keeps_its_material(stage, tmp_path):
    """One that is left out, a ball, one that is hidden: the copy for the baked mesh has all that the material has."""
    material = add_material(stage, "/looks/wood", roughness=0.25)
    for name in ("baked", "left", "hidden"):
        bind(add_mesh(stage, f"/{name}"), material)
    UsdGeom.Imageable(stage.GetPrimAtPath("/hidden")).MakeInvisible()
    bind(UsdGeom.Sphere.Define(stage, "/ball"), material)
    source, target = saved(stage), tmp_path / "a_ao.usda"
    write_baked(source, target, exclude=("left",))
    baked = Usd.Stage.Open(str(target))
    assert_the_rest_is_the_same(source, target, "/baked.material:binding")
    copy = UsdShade.MaterialBindingAPI(baked.GetPrimAtPath("/baked")).ComputeBoundMaterial()[0]
    assert copy.GetPath() == "/looks/wood_ao"
    assert copy.ComputeSurfaceSource()[0].GetInput("roughness").Get() == 0.25
    occlusion_texture(baked.GetPrimAtPath("/baked"))
    plain = UsdShade.Material(baked.GetPrimAtPath("/looks/wood")).ComputeSurfaceSource()[0]
    assert not plain.GetInput("occlusion")


def test_an_earlier_occlusion_is_replaced(stage, prim_at, tmp_path):
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood"))
    write_baked(saved(stage), tmp_path / "b.usda")
    write_baked(tmp_path / "b.usda", tmp_path / "c.usda", keep=True)
    first, second = (authored(tmp_path / f"{name}.usda") for name in "bc")
    assert first.keys() == second.keys()
    picture = occlusion_texture(prim_at(tmp_path / "c.usda", "/box"))[0].GetInput("file")
    assert picture.Get().path == "./c.png"


@pytest.mark.parametrize(
    ("interpolation", "values", "color"),
    [("constant", [(1, 0.5, 0)], (1, 0.5, 0)), ("vertex", [(0, 0, 1)] * 8, None), (None, [], None)],
)
def test_a_mesh_without_material_keeps_its_colour(stage, prim_at, tmp_path, interpolation, values, color):
    root = UsdGeom.Xform.Define(stage, "/asset")
    stage.SetDefaultPrim(root.GetPrim())
    mesh = add_mesh(stage, "/asset/box")
    if interpolation:
        mesh.CreateDisplayColorPrimvar(interpolation).Set(values)
    source, target = saved(stage), tmp_path / "a_ao.usda"
    write_baked(source, target)
    prim = prim_at(target, "/asset/box")
    occlusion_texture(prim)
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    assert material.GetPath().HasPrefix("/asset")  # there where the default prim is referenced
    given = material.ComputeSurfaceSource()[0].GetInput("diffuseColor")
    if interpolation is None:
        assert not given
    elif color:
        assert given.Get() == color
    else:
        reader = UsdShade.Shader(given.GetConnectedSource()[0].GetPrim())
        assert (reader.GetShaderId(), reader.GetInput("varname").Get()) == ("UsdPrimvarReader_float3", "displayColor")
    assert complaints(target) <= complaints(source)
    assert_the_rest_is_the_same(source, target)


def test_subsets_get_the_occlusion_of_their_materials(stage, prim_at, tmp_path):
    mesh = add_mesh(stage, "/box")
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("lid", [1, 3])
    bind(subset, add_material(stage, "/looks/lid"))
    source, target = saved(stage), tmp_path / "a_ao.usda"
    scene, atlas, _ = write_baked(source, target)
    prim = prim_at(target, "/box")
    expected = np.where(
        np.isnan(first := expected_uvs(scene, atlas, scene.parts[0], 24)),
        expected_uvs(scene, atlas, scene.parts[1], 24),
        first,
    )
    for owner in (prim, prim.GetChild("lid")):  # the rest of the box has no material of its own
        assert shown_uvs(prim, owner) == pytest.approx(expected, abs=1e-6)
    assert_the_rest_is_the_same(source, target)


@pytest.mark.parametrize("context", ["mtlx", ""])
def test_what_shows_no_texture_is_named(stage, tmp_path, context):
    material = add_material(stage, "/looks/oak") if context else UsdShade.Material.Define(stage, "/looks/oak")
    shader = UsdShade.Shader.Define(stage, "/looks/oak/standard")
    shader.CreateIdAttr("ND_standard_surface_surfaceshader")
    material.CreateSurfaceOutput(context).ConnectToSource(shader.ConnectableAPI(), "surface")
    bind(add_mesh(stage, "/box"), material)
    source, target = saved(stage), tmp_path / "a_ao.usda"
    _, _, written = write_baked(source, target)
    (line,) = written.messages
    assert ("surfaces for other renderers: oak" if context else "oak has no UsdPreviewSurface") in line
    assert len(written.references) == bool(context)
    assert_the_rest_is_the_same(source, target)


def test_faces_that_change_with_time_are_named(stage, tmp_path):
    mesh = add_mesh(stage, "/box")
    mesh.GetFaceVertexCountsAttr().Set([4] * 6, 1)
    mesh.GetFaceVertexCountsAttr().Set([3] * 8, 2)
    bind(mesh, add_material(stage, "/looks/wood"))
    _, _, written = write_baked(saved(stage), tmp_path / "a_ao.usda")
    assert any("faces of /box change with time" in line for line in written.messages)


# Other folders.


def test_in_another_folder_pictures_are_copied_and_layers_are_found(stage, tmp_path):
    (tmp_path / "maps").mkdir()
    for name in ("maps/wood.png", "leaf.png"):
        Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / name)
    chair = Usd.Stage.CreateNew(str(tmp_path / "chair.usda"))
    bind(add_mesh(chair, "/chair/seat"), add_material(chair, "/chair/looks/leaf", "./leaf.png", "rgb", "diffuseColor"))
    chair.GetRootLayer().Save()
    stage.DefinePrim("/chair").GetReferences().AddReference("./chair.usda", "/chair")
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood", "maps/wood.png", "rgb", "diffuseColor"))
    source, target = saved(stage), tmp_path / "out" / "a_ao.usda"
    scene, atlas, written = write_baked(source, target)
    assert sorted(path.name for path in target.parent.iterdir()) == ["a_ao.png", "a_ao.usda", "wood.png"]
    baked = Usd.Stage.Open(str(target))
    for part in scene.parts:
        prim = baked.GetPrimAtPath(part.source.prim)
        assert shown_uvs(prim) == pytest.approx(expected_uvs(scene, atlas, part, 24), abs=1e-6)
    assert not UsdUtils.ComputeAllDependencies(str(target))[2]
    assert "@../chair.usda@" in target.read_text()
    (line,) = written.messages
    assert "1 file stays in" in line


def test_beside_its_source_a_stage_names_the_same_files(stage, tmp_path):
    stage.DefinePrim("/lost").GetReferences().AddReference("./lost.usda")
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood", "gone.png", "rgb", "diffuseColor"))
    write_baked(saved(stage), tmp_path / "a_ao.usda")
    text = (tmp_path / "a_ao.usda").read_text()
    assert sorted(re.findall("@(.*?)@", text)) == ["./a_ao.png", "./lost.usda", "gone.png"]


@pytest.mark.parametrize(
    ("source", "target", "found"),
    [("a.usda", "b.usdz", "a package is written of a package"), ("a.usdz", "b.usda", r"write a \.usdz")],
)
def test_a_package_is_made_of_a_package_only(stage, tmp_path, source, target, found):
    bind(add_mesh(stage, "/box"), add_material(stage, "/looks/wood"))
    with pytest.raises(UsageError, match=found):
        write_baked(saved(stage, source[1:]), tmp_path / target)
    assert not (tmp_path / target).exists()


def test_what_is_no_usd_does_not_become_one(cube_obj, command, tmp_path):
    done = command("bake", cube_obj, "-o", tmp_path / "out.usda")
    assert done.returncode == 2
    assert "USD is written of USD only" in done.stderr


def test_each_kind_stays_its_kind(stage, tmp_path):
    add_mesh(stage, "/box")
    for suffix in SUFFIXES:
        assert output_mesh_extension(load_scene(saved(stage, suffix))) == (suffix, "")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_command_finds_the_occlusion(stage, tmp_path, command, suffix):
    """A box in a larger one, seen from both sides: verify knows so from the file, and what was shared is compared."""
    bind(add_mesh(stage, "/inner"), add_material(stage, "/looks/wood"))
    outer = add_mesh(stage, "/outer", faces=SIDES[:5])
    outer.AddScaleOp().Set((3, 3, 3))
    source, out = saved(stage, suffix), tmp_path / "out"
    target = out / f"a_ao{suffix}"
    out.mkdir()
    output = target if suffix == ".usdz" else out
    done = command("bake", source, "--size", 128, "-n", 256, "--two-sided", "-o", output)
    assert done.returncode == 0, done.stderr
    assert sorted(path.suffix for path in out.iterdir()) == ([".usdz"] if suffix == ".usdz" else [".png", suffix])
    verified = command("verify", target, "--json")
    report = json.loads(verified.stdout)
    assert report["levels"][0]["rmse"] < 0.05
    assert "--two-sided" in verified.stderr
    assert command("compare", target, target).returncode == 0
    assert command("preview", target, "-o", tmp_path / "x.png", "--size", "64x64").returncode == 0
    assert command("report", out, "-o", tmp_path / "x.html").returncode == 0


@pytest.mark.parametrize(
    ("tiles", "options", "names"), [(1, ["--textures", "material"], ["wood", "steel"]), (2, [], ["1001", "1002"])]
)
def test_several_textures_make_a_glb_and_are_told(stage, tmp_path, command, tiles, options, names):
    """Two squares of two materials, or on two UDIM tiles."""
    for number, name in enumerate(("wood", "steel")):
        square = add_mesh(stage, f"/{name}", [(x + 3 * number, y, z) for x, y, z in QUAD], [[0, 1, 2, 3]])
        add_uvs(square, "st", [(0.8 * u + 0.1 + number * (tiles - 1), 0.8 * v + 0.1) for u, v in SQUARE])
        bind(square, add_material(stage, f"/looks/{name}"))
    done = command("bake", saved(stage), "--size", 32, "-n", 64, "-o", f"{tmp_path}/out/", *options)
    assert done.returncode == 0, done.stderr
    assert "USD is written with one texture, so the mesh becomes a GLB with all" in done.stderr
    pictures = sorted(f"a_ao.{name}.png" for name in names)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(["a_ao.glb", *pictures])
