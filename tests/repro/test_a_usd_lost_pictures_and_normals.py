"""A USD that was written lost pictures with names of certain kinds, normals by time and materials of previews."""

import sys

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils

from aoprecalc.errors import InputError, KilledError
from aoprecalc.io import load_scene
from usd_stages import SQUARE, add_material, add_mesh, add_uvs, bind, write_baked


def test_a_package_keeps_names_that_are_not_ascii(tmp_path):
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "bück.png")
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = add_mesh(stage, "/box")
    add_uvs(mesh, "st", SQUARE, indices=[0, 1, 2, 3] * 6)
    bind(mesh, add_material(stage, "/looks/wood", "./bück.png", "rgb", "diffuseColor"))
    stage.GetRootLayer().Save()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usda"), str(tmp_path / "a.usdz"))
    for source, target in (("a.usdz", "b.usdz"), ("b.usdz", "c.usdz")):
        write_baked(tmp_path / source, tmp_path / target)
        _, assets, missing = UsdUtils.ComputeAllDependencies(str(tmp_path / target))
        assert not missing
        assert any(asset.endswith("[bück.png]") for asset in assets)


@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_normals_by_time_make_way_for_those_used(tmp_path, name):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = add_mesh(stage, "/box")
    kind = Sdf.ValueTypeNames.Normal3fArray
    attribute = (
        mesh.GetNormalsAttr()
        if name == "normals"
        else UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", kind, "vertex").GetAttr()
    )
    for time in (1, 5):
        attribute.Set([Gf.Vec3f(time, 0, 0)] * 8, time)
    bind(mesh, add_material(stage, "/looks/wood"))
    stage.GetRootLayer().Save()
    normals = np.tile(np.float32([0, 0.6, 0.8]), (12, 3, 1))
    write_baked(tmp_path / "a.usda", tmp_path / "b.usda", normals=normals)
    back = load_scene(tmp_path / "b.usda")
    assert back.warnings == ()
    assert back.normals == pytest.approx(normals, abs=1e-6)
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    for time in (1, 5):
        shown = np.array(baked.GetPrimAtPath("/box").GetAttribute(name).Get(time))
        assert shown == pytest.approx(np.tile([0, 0.6, 0.8], (24, 1)), abs=1e-6)


def test_tiles_and_names_with_brackets_move_to_another_folder(tmp_path):
    names = ("tex.<UDIM>.png", "./skin.<UDIM>.png", "./a[1].png")
    for name in ("tex.1001.png", "tex.1012.png", "skin.1001.png", "a[1].png", "tex.x001.png"):
        Image.new("RGB", (2, 2), (len(name), 100, 50)).save(tmp_path / name)
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = add_mesh(stage, "/box")
    add_uvs(mesh, "st", SQUARE, indices=[0, 1, 2, 3] * 6)
    for number, name in enumerate(names):
        look = add_material(stage, f"/looks/look{number}", name, "rgb", "diffuseColor")
        bind(add_mesh(stage, f"/box{number}") if number else mesh, look)
    stage.GetRootLayer().Save()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "skin.1001.png").write_bytes(b"of another")
    _, _, written = write_baked(tmp_path / "a.usda", tmp_path / "out" / "b.usda")
    assert written.messages == ()
    text = (tmp_path / "out" / "b.usda").read_text(encoding="utf-8")
    for name in ("./tex.<UDIM>.png", "./skin.<UDIM>_1.png", "./a[1].png"):
        assert f"@{name}@" in text
    for name in ("tex.1001.png", "tex.1012.png", "a[1].png"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / name).read_bytes()
    for file in tmp_path.glob("*.png"):
        file.unlink()
    _, assets, missing = UsdUtils.ComputeAllDependencies(str(tmp_path / "out" / "b.usda"))
    assert not missing
    assert len(assets) == 5  # with the texture of the bake


def test_a_binding_for_previews_gets_the_occlusion(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    first, second = (add_mesh(stage, f"/{name}") for name in ("first", "second"))
    look = add_material(stage, "/looks/wood", diffuseColor=(0.5, 0.25, 1.0))
    for mesh in (first, second):
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(look, materialPurpose=UsdShade.Tokens.preview)
    add_uvs(second, "st1", SQUARE, indices=[0, 1, 2, 3] * 6)
    stage.GetRootLayer().Save()
    scene, _, written = write_baked(tmp_path / "a.usda", tmp_path / "b.usda", exclude=("second",))
    assert written.messages == ()
    assert [part.source.look.name for part in scene.parts] == ["wood", "wood"]
    baked = Usd.Stage.Open(str(tmp_path / "b.usda"))
    for name, has in (("first", True), ("second", False)):
        api = UsdShade.MaterialBindingAPI(baked.GetPrimAtPath(f"/{name}"))
        material, relationship = api.ComputeBoundMaterial(UsdShade.Tokens.preview)
        assert relationship.GetName() == "material:binding:preview"
        surface = material.ComputeSurfaceSource()[0]
        assert bool(surface.GetInput("occlusion")) is has
        assert surface.GetInput("diffuseColor").Get() == (0.5, 0.25, 1.0)
        assert not api.ComputeBoundMaterial()[0]  # nothing new for other purposes


def test_a_child_that_is_killed_leaves_no_folder(tmp_path, monkeypatch):
    program = """import os
from pxr import Sdf
from aoprecalc.io.formats.usd import answer
Sdf.Layer.Export = lambda *_: os.kill(os.getpid(), 9)
answer()"""
    child = "aoprecalc.io.formats.library_process.LibraryProcess.command"
    monkeypatch.setattr(child, [sys.executable, "-P", "-c", program])
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr("tempfile.tempdir", None)
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    add_mesh(stage, "/box")
    stage.GetRootLayer().Save()
    with pytest.raises((InputError, KilledError)):
        write_baked(tmp_path / "a.usda", tmp_path / "b.usda")
    assert not list((tmp_path / "temporary").iterdir())
    assert not (tmp_path / "b.usda").exists()
