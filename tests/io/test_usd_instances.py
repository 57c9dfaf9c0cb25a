"""Instances, point instances and variants of USD: each gets the texture on its own corners, and the others stay."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.io.formats.textures import output_uvs
from usd_stages import CORNERS, QUAD, SIDES, add_material, add_mesh, bind, write_baked


@pytest.fixture
def stage(tmp_path):
    return Usd.Stage.CreateNew(str(tmp_path / "a.usda"))


def saved(stage, tmp_path):
    stage.GetRootLayer().Save()
    return tmp_path / "a.usda"


def add_stool(stage, root="/stool"):
    """A mesh with a material of its own, and one without."""
    bind(add_mesh(stage, f"{root}/seat"), add_material(stage, f"{root}/looks/wood"))
    add_mesh(stage, f"{root}/foot", QUAD, [[0, 1, 2, 3]])


def shown(stage, path):
    """The UVs of the occlusion at each face corner of a Mesh, as a renderer finds them, and the material's path."""
    prim = stage.GetPrimAtPath(path)
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    texture = material.ComputeSurfaceSource()[0].GetInput("occlusion").GetConnectedSource()[0].GetPrim()
    reader = UsdShade.Shader(texture).GetInput("st").GetConnectedSource()[0].GetPrim()
    name = UsdShade.Shader(reader).GetInput("varname").Get()
    return np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar(name).ComputeFlattened()), material.GetPath()


def assert_shown(stage, scene, atlas):
    """Each part shows the texture on the UVs of the atlas."""
    for part in scene.parts:
        if part.receives:
            found = shown(stage, part.source.prim)[0][part.source.corners[part.source.polygons.triangles]]
            assert found == pytest.approx(output_uvs(scene, atlas)[part.faces], abs=1e-6)


def add_instances(stage, folder, nested=False):
    """Three instances of a stool in another file, one of them mirrored; or two instances of a set of two."""
    asset = Usd.Stage.CreateNew(str(folder / "stools.usda"))
    add_stool(asset)
    for number, name in enumerate(("one", "two")):
        inner = UsdGeom.Xform.Define(asset, f"/set/{name}")
        inner.AddTranslateOp().Set((0, 5 * number, 0))
        inner.GetPrim().GetReferences().AddInternalReference("/stool")
        inner.GetPrim().SetInstanceable(True)
    asset.GetRootLayer().Save()
    for number, name in enumerate(("one", "two") if nested else ("one", "two", "three")):
        copy = UsdGeom.Xform.Define(stage, f"/{name}")
        copy.AddTranslateOp().Set((10 * number, 0, 0))
        copy.AddScaleOp().Set((-1 if number == 1 else 1, 1, 1))
        copy.GetPrim().GetReferences().AddReference("./stools.usda", "/set" if nested else "/stool")
        copy.GetPrim().SetInstanceable(True)


@pytest.mark.parametrize("nested", [False, True])
def test_instances_become_prims_of_their_own(stage, tmp_path, nested):
    add_instances(stage, tmp_path, nested)
    scene, atlas, written = write_baked(saved(stage, tmp_path), tmp_path / "b.usda")
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    assert len(scene.parts) == (8 if nested else 6)
    assert_shown(baked, scene, atlas)
    assert not baked.GetPrototypes()
    assert any("instances became separate prims (--instances share" in line for line in written.messages)
    assert np.array_equal(load_scene(tmp_path / "b.usda").corners, scene.corners)


@pytest.mark.parametrize("nested", [False, True])
def test_shared_instances_keep_their_prototype(stage, tmp_path, nested):
    add_instances(stage, tmp_path, nested)
    source = saved(stage, tmp_path)
    scene, atlas, written = write_baked(source, tmp_path / "b.usda", instances="share")
    baked, before = Usd.Stage.Open(str(tmp_path / "b.usda")), Usd.Stage.Open(str(source))
    assert len(baked.GetPrototypes()) == len(before.GetPrototypes())
    assert_shown(baked, scene, atlas)
    assert written.messages == ()
    assert sum(part.uv_owner is None for part in scene.parts) == 2
    assert [use.uvs for use in written.references] == ["primvars:st1"]


def test_an_instance_that_is_left_out_stays_one(stage, tmp_path):
    add_instances(stage, tmp_path)
    scene, atlas, _ = write_baked(saved(stage, tmp_path), tmp_path / "b.usda", exclude=("two",))
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    assert_shown(baked, scene, atlas)
    assert baked.GetPrimAtPath("/two").IsInstance()
    assert not baked.GetPrimAtPath("/one").IsInstance()


def test_an_instance_with_subsets_and_one_material_for_all(stage, tmp_path):
    add_material(stage, "/looks/wood")
    mesh = add_mesh(stage, "/box/mesh")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("lid", [1, 3])
    stage.GetPrimAtPath("/box").SetSpecifier(Sdf.SpecifierClass)
    for number in range(2):
        copy = UsdGeom.Xform.Define(stage, f"/copy{number}")
        copy.AddTranslateOp().Set((10 * number, 0, 0))
        copy.GetPrim().GetReferences().AddInternalReference("/box")
        copy.GetPrim().SetInstanceable(True)
        bind(copy, UsdShade.Material(stage.GetPrimAtPath("/looks/wood")))
    source = saved(stage, tmp_path)
    for instances in ("bake", "share"):
        scene, atlas, written = write_baked(source, tmp_path / f"{instances}.usda", instances=instances)
        baked = Usd.Stage.Open(str(tmp_path / f"{instances}.usda"))
        assert len(baked.GetPrototypes()) == (instances == "share")
        assert shown(baked, "/copy1/mesh")[1] == "/looks/wood"
        assert_shown(baked, scene, atlas)
        assert [use.materials for use in written.references] == [1]


# Point instances.


def add_trees(stage, positions, indices, root="/forest"):
    instancer = UsdGeom.PointInstancer.Define(stage, root)
    add_stool(stage, f"{root}/kinds/stool")
    add_mesh(stage, f"{root}/kinds/stone", QUAD, [[0, 1, 2, 3]])
    UsdGeom.Xformable(stage.GetPrimAtPath(f"{root}/kinds/stone")).AddTranslateOp().Set((0, 0, 7))
    UsdGeom.Xformable(stage.GetPrimAtPath(f"{root}/kinds/stool/foot")).AddTranslateOp().Set((0, 5, 0))
    instancer.CreatePrototypesRel().SetTargets([f"{root}/kinds/stool", f"{root}/kinds/stone"])
    instancer.CreatePositionsAttr(positions)
    instancer.CreateProtoIndicesAttr(indices)
    return instancer


def centers(scene):
    return [scene.corners[part.faces].reshape(-1, 3).mean(axis=0).round(4).tolist() for part in scene.parts]


def test_point_instances_are_where_pxr_places_them(stage, tmp_path):
    """Turned by a quarter about z, of double size and mirrored, in a group that is moved; the last one is hidden."""
    UsdGeom.Xform.Define(stage, "/group").AddTranslateOp().Set((100, 0, 0))
    instancer = add_trees(stage, [(0, 0, 0), (10, 0, 0), (20, 0, 0), (30, 0, 0)], [1, 1, 0, 1], "/group/forest")
    instancer.CreateOrientationsAttr([Gf.Quath(0.5**0.5, 0, 0, 0.5**0.5), *[Gf.Quath(1, 0, 0, 0)] * 3])
    instancer.CreateScalesAttr([(1, 1, 1), (-2, 1, 1), (1, 1, 1), (1, 1, 1)])
    instancer.InvisId(3, Usd.TimeCode.Default())
    scene = load_scene(saved(stage, tmp_path))
    assert [part.name for part in scene.parts] == ["stone", "stone", "seat", "foot"]
    expected = [[99, 1, 7], [108, 1, 7], [120, 0, 0], [121, 6, 0]]
    assert np.array(centers(scene)) == pytest.approx(np.array(expected), abs=1e-3)  # quaternions are half floats
    assert {"forest", "/group/forest", "stone"} <= scene.parts[0].names
    assert [part.duplicate_of for part in scene.parts] == [None, 0, None, None]
    assert any(line.startswith("3 point instances share the texels") for line in scene.notes)
    up = np.cross(*np.diff(scene.corners[:4], axis=1).transpose(1, 0, 2))
    assert (up[:, 2] > 0).all()


def test_point_instances_share_the_texture_of_their_prototype(stage, tmp_path):
    add_trees(stage, [(0, 0, 0), (10, 0, 0), (20, 0, 0)], [0, 1, 0]).CreateScalesAttr(
        [(1, 1, 1), (1, 1, 1), (-1, 1, 1)]
    )
    scene, atlas, written = write_baked(saved(stage, tmp_path), tmp_path / "b.usda")
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    assert_shown(baked, scene, atlas)
    assert [use.materials for use in written.references] == [2]  # wood, and a plain one for all without a material
    assert np.array_equal(load_scene(tmp_path / "b.usda").corners, scene.corners)


def test_point_instancers_may_be_nested(stage, tmp_path):
    add_trees(stage, [(0, 0, 0), (0, 20, 0)], [1, 1], "/woods/forest")
    woods = UsdGeom.PointInstancer.Define(stage, "/woods")
    woods.CreatePrototypesRel().SetTargets(["/woods/forest"])
    woods.CreatePositionsAttr([(0, 0, 0), (100, 0, 0)])
    woods.CreateProtoIndicesAttr([0, 0])
    scene, atlas, _ = write_baked(saved(stage, tmp_path), tmp_path / "b.usda")
    assert centers(scene) == [[1, 1, 7], [1, 21, 7], [101, 1, 7], [101, 21, 7]]
    assert [part.uv_owner for part in scene.parts] == [None, 0, 0, 0]
    assert_shown(Usd.Stage.Open(str(tmp_path / "b.usda")), scene, atlas)


def test_hidden_prototypes_are_shown_by_their_instancer(stage, tmp_path):
    add_trees(stage, [(0, 0, 0)], [1])
    UsdGeom.Imageable(stage.GetPrimAtPath("/forest/kinds")).MakeInvisible()  # above the prototypes
    assert len(load_scene(saved(stage, tmp_path)).parts) == 1
    UsdGeom.Imageable(stage.GetPrimAtPath("/forest/kinds/stone")).MakeInvisible()
    with pytest.raises(InputError, match="1 invisible mesh left out"):
        load_scene(saved(stage, tmp_path))


@pytest.mark.parametrize(
    ("indices", "found"), [([0, 5, 0], "prototype 5 cannot be found"), ([0], "some of 1 positions cannot be found")]
)
def test_a_damaged_point_instancer_is_told(stage, tmp_path, indices, found):
    add_trees(stage, [(0, 0, 0)] * 3, indices)
    with pytest.raises(InputError, match=f"/forest: {found}"):
        load_scene(saved(stage, tmp_path))


def test_a_point_instancer_of_itself_is_told(stage, tmp_path):
    forest = add_trees(stage, [(0, 0, 0)], [0])
    forest.GetPrototypesRel().SetTargets(["/forest"])
    with pytest.raises(InputError, match="/forest is a prototype of itself"):
        load_scene(saved(stage, tmp_path))


# Variants.


def add_variants(stage, path, name, makers):
    variants = stage.GetPrimAtPath(path).GetVariantSets().AddVariantSet(name)
    for variant, make in makers.items():
        variants.AddVariant(variant)
        variants.SetVariantSelection(variant)
        with variants.GetVariantEditContext():
            make()
    return variants


def test_faces_in_a_variant_get_their_uvs_there(stage, tmp_path):
    UsdGeom.Xform.Define(stage, "/tree")
    add_variants(
        stage,
        "/tree",
        "detail",
        {
            "low": lambda: add_mesh(stage, "/tree/mesh", QUAD, [[0, 1, 2, 3]]),
            "high": lambda: add_mesh(stage, "/tree/mesh", CORNERS, SIDES),
        },
    )
    bind(UsdGeom.Xform(stage.GetPrimAtPath("/tree")), add_material(stage, "/tree/looks/bark"))
    source = saved(stage, tmp_path)
    scene, atlas, _ = write_baked(source, tmp_path / "b.usda")
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    assert_shown(baked, scene, atlas)
    baked.GetPrimAtPath("/tree").GetVariantSet("detail").SetVariantSelection("low")
    mesh = baked.GetPrimAtPath("/tree/mesh")
    assert len(UsdGeom.Mesh(mesh).GetFaceVertexCountsAttr().Get()) == 1
    assert not mesh.HasAttribute("primvars:st1")


def test_faces_that_a_variant_refers_to_get_their_uvs_there(stage, tmp_path):
    """The mesh of each variant is in another file, which the variant refers to, and the set in a third."""
    for name, faces in (("low", [[0, 1, 2, 3]]), ("high", [[0, 1, 2], [0, 2, 3]])):
        other = Usd.Stage.CreateNew(str(tmp_path / f"{name}.usda"))
        add_mesh(other, "/tree/mesh", QUAD, faces)
        other.GetRootLayer().Save()
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    UsdGeom.Xform.Define(asset, "/asset/tree")
    refer = {
        name: lambda name=name: (
            asset.GetPrimAtPath("/asset/tree").GetReferences().AddReference(f"./{name}.usda", "/tree")
        )
        for name in ("low", "high")
    }
    add_variants(asset, "/asset/tree", "detail", refer)
    asset.GetRootLayer().Save()
    stage.DefinePrim("/here").GetReferences().AddReference("./asset.usda", "/asset")
    scene, atlas, _ = write_baked(saved(stage, tmp_path), tmp_path / "b.usda")
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    assert_shown(baked, scene, atlas)
    baked.GetPrimAtPath("/here/tree").GetVariantSet("detail").SetVariantSelection("low")
    assert baked.GetPrimAtPath("/here/tree/mesh")
    assert not baked.GetPrimAtPath("/here/tree/mesh").HasAttribute("primvars:st1")


def test_a_material_of_a_variant_stays_that_of_the_others(stage, tmp_path):
    """Bound in the variants of a look; the red one is used by what is not baked, too, so that it gets a copy."""
    add_mesh(stage, "/car")
    looks = {name: add_material(stage, f"/looks/{name}") for name in ("blue", "red")}
    add_variants(
        stage,
        "/car",
        "look",
        {name: lambda name=name: bind(stage.GetPrimAtPath("/car"), looks[name]) for name in looks},
    )
    bind(add_mesh(stage, "/left"), looks["red"])
    scene, atlas, _ = write_baked(saved(stage, tmp_path), tmp_path / "b.usda", exclude=("left",))
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    assert shown(baked, "/car")[1] == "/looks/red_ao"
    assert_shown(baked, scene, atlas)
    baked.GetPrimAtPath("/car").GetVariantSet("look").SetVariantSelection("blue")
    bound = UsdShade.MaterialBindingAPI(baked.GetPrimAtPath("/car")).ComputeBoundMaterial()[0]
    assert bound.GetPath() == "/looks/blue"
