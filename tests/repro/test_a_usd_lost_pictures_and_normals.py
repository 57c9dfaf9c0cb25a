"""A USD that was written lost pictures whose names are not ASCII, and its normals where the source had them by time."""

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils

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
