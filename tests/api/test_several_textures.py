"""Bakes of several textures: which faces have which, what each holds, and how files refer to them."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pygltflib
import pytest
import trimesh
from PIL import Image

import aoprecalc as ao
from aoprecalc.api.bake_textures import bake_textures, safe_names
from aoprecalc.api.report_assets import collect_assets
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.errors import ArgumentError
from aoprecalc.io import load_scene
from aoprecalc.io.occlusion import every_occlusion, mesh_beside
from aoprecalc.mesh.surface import face_normals, sample_surface
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.texture_lookup import TextureStack, bilinear
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import issues, needs_validator
from shapes import box, quad

FEW = {"size": 64, "directions": 256, "backend": "ray"}
OBJECTS = (
    ("table", "wood", box()),
    ("chair", "wood", (box()[0] * 0.5 + [1.5, 0, 0], box()[1])),
    ("floor", "stone", quad((-2, -0.05, 3), (6, 0, 0), (0, 0, -6), 4)),
)


def obj_room(path, objects=OBJECTS, materials=("wood", "stone")):
    """An OBJ of objects with materials, and its MTL."""
    path.with_suffix(".mtl").write_text("".join(f"newmtl {name}\nKd 0.5 0.5 0.5\n" for name in materials))
    lines, count = [f"mtllib {path.stem}.mtl"], 1
    for name, material, (positions, faces) in objects:
        lines += [f"o {name}", *(f"v {x} {y} {z}" for x, y, z in positions), f"usemtl {material}"]
        lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(faces) + count]
        count += len(positions)
    path.write_text("\n".join(lines) + "\n")
    return path


def gltf_room(folder, names=("table", "chair", "floor"), materials=("wood", "stone")):
    """A GLB of three meshes, of which two have one material."""
    maker = GltfMaker(folder)
    numbers = [maker.add("materials", {"name": name}) for name in materials]
    for (_, material, (positions, faces)), name in zip(OBJECTS, names, strict=True):
        corners = np.asarray(positions, "<f4")[np.asarray(faces).ravel()]
        primitive = {
            "attributes": {"POSITION": maker.vertices(corners, bounds=True)},
            "material": numbers[("wood", "stone").index(material)],
        }
        mesh = maker.mesh(primitive)
        maker.json["meshes"][mesh]["name"] = name
        maker.node(mesh=mesh)
    return maker.save("room.glb")


@pytest.fixture
def room(tmp_path):
    return obj_room(tmp_path / "room.obj")


@pytest.mark.parametrize(
    ("by", "names"), [("one", [""]), ("material", ["wood", "stone"]), ("mesh", ["table", "chair", "floor"])]
)
def test_each_face_has_one_texture_whose_values_are_those_of_rays(room, by, names):
    """All parts occlude: the values are those of the one scene, whatever texture holds them."""
    options = BakeOptions(**FEW, textures=by)
    result = ao.bake(room, options)
    assert [texture.name for texture in result.textures] == names == [one.name for one in result.report.textures]
    assert (sum(texture.faces.astype(int) for texture in result.textures) == 1).all()
    whole = result._baked
    points = sample_surface(whole.scene, whole.atlas.mapped, 2000, 0)
    expected = reference_ao(whole.scene, whole.normals, points, VerifyOptions(rays=400), Progress())
    joined = bilinear(result.ao, points.interpolate(result.mesh.uvs), repeats=False)
    assert np.sqrt(np.mean((joined - expected) ** 2)) < 0.04
    for texture in result.textures:
        assert texture.ao.shape == (64, 64)
        own = texture.faces[points.faces]
        values = bilinear(texture.ao, points.interpolate(texture.uvs)[own], repeats=False)
        assert values == pytest.approx(joined[own], abs=1e-6)


def test_a_share_of_the_diagonal_is_of_the_whole_scene(room):
    options = BakeOptions(**FEW, textures="mesh", max_distance="10%")
    bake = bake_textures(load_scene(room), options)
    assert bake.whole.options.max_distance == "10%"
    whole = ao.bake(room, BakeOptions(**FEW, max_distance="10%"), verify=True)
    several = ao.bake(room, options, verify=True)
    assert several.report.verify.levels[0].rmse == pytest.approx(whole.report.verify.levels[0].rmse, abs=0.01)


def test_the_materials_of_a_gltf_refer_each_to_its_texture(tmp_path):
    """Two meshes of one material have textures of their own, so that the material is there twice."""
    result = ao.bake(gltf_room(tmp_path), BakeOptions(**FEW, textures="mesh"))
    files = result.save(tmp_path / "out.gltf")
    assert [path.name for path in files.textures] == ["out_ao.table.png", "out_ao.chair.png", "out_ao.floor.png"]
    document = pygltflib.GLTF2().load(files.mesh)
    assert [material.name for material in document.materials] == ["wood", "stone", "wood_chair"]
    shown = {}
    for mesh in document.meshes:
        material = document.materials[mesh.primitives[0].material]
        shown[mesh.name] = document.images[document.textures[material.occlusionTexture.index].source].uri
    assert shown == {name: f"out_ao.{name}.png" for name in ("table", "chair", "floor")}
    for texture, path in zip(result.textures, files.textures, strict=True):
        assert np.asarray(Image.open(path)) / 255 == pytest.approx(texture.ao, abs=0.51 / 255)


def test_every_texture_is_inside_a_glb_on_its_faces(tmp_path):
    result = ao.bake(gltf_room(tmp_path), BakeOptions(**FEW, textures="material"))
    files = result.save(tmp_path / "out.glb")
    assert (files.texture, files.textures) == (None, ())
    found = every_occlusion(load_scene(files.mesh))
    assert [picture.shown.tolist() for picture in found] == [texture.faces.tolist() for texture in result.textures]
    for picture, texture in zip(found, result.textures, strict=True):
        assert picture.values == pytest.approx(texture.ao, abs=0.51 / 255)
        assert picture.uvs[picture.shown] == pytest.approx(texture.uvs[texture.faces], abs=1e-6)
    assert len(trimesh.load(files.mesh).geometry) == 3


@needs_validator
@pytest.mark.parametrize("by", ["material", "mesh"])
def test_the_validator_accepts_several_textures(tmp_path, by):
    files = ao.bake(gltf_room(tmp_path), BakeOptions(**FEW, textures=by)).save(tmp_path / "out.glb")
    assert issues(files.mesh) == [[]]


def test_the_materials_of_an_obj_refer_each_to_its_texture(room, tmp_path):
    files = ao.bake(room, BakeOptions(**FEW, textures="mesh")).save(f"{tmp_path}/out/")
    library = files.mesh.with_suffix(".mtl").read_text().split("newmtl ")[1:]
    shown = {entry.split()[0]: entry.split("map_Kd ")[1].strip() for entry in library}
    assert shown == {
        "wood_table": "room_ao.table.png",
        "wood_chair": "room_ao.chair.png",
        "stone": "room_ao.floor.png",
    }
    lines = files.mesh.read_text().splitlines()
    assert Counter(line for line in lines if line.startswith("usemtl")) == Counter(f"usemtl {name}" for name in shown)


def test_names_are_safe_and_differ():
    assert safe_names(["a b", "A B", "a/b", "", "ä", "x" * 99]) == [
        "a_b", "A_B_2", "a_b_3", "default", "default_2", "x" * 60,
    ]  # fmt: skip


def test_materials_of_one_name_have_textures_of_their_own(tmp_path):
    result = ao.bake(gltf_room(tmp_path, materials=("paint", "Paint")), BakeOptions(**FEW, textures="material"))
    files = result.save(tmp_path / "out.gltf")
    assert [path.name for path in files.textures] == ["out_ao.paint.png", "out_ao.Paint_2.png"]


def test_a_part_that_is_large_in_its_own_texture_alone_is_no_sky(tmp_path):
    hubs = [(f"hub {number}", "steel", box((number, -1, 0), (number + 0.2, -0.8, 0.2))) for number in range(6)]
    body = "body", "paint", box((0, 0, 0), (4, 4, 4))
    found = {}
    for name, shape in (("rack", box((0, 0, 4.2), (4, 1, 4.3))), ("sky", box((-40, -40, -40), (40, 40, 40)))):
        path = obj_room(tmp_path / f"{name}.obj", (*hubs, body, (name, "steel", shape)), ("paint", "steel"))
        report = ao.bake(path, BakeOptions(textures="material", normals="flat", **FEW)).report
        found[name] = [line for line in report.warnings if "far larger than the rest" in line]
    assert found["rack"] == []
    assert [line.startswith("steel: 'sky': ") for line in found["sky"]] == [True]


def test_the_same_input_gives_the_same_bytes(room, tmp_path):
    written = []
    for folder in ("a", "b"):
        options = BakeOptions(**FEW, textures="mesh")
        (tmp_path / folder).mkdir()
        ao.bake(room, options).save(tmp_path / folder / "room_ao.glb")
        written.append((tmp_path / folder / "room_ao.glb").read_bytes())
    assert written[0] == written[1]


def test_values_at_vertices_are_fitted_to_all_textures(room):
    one, several = (
        ao.bake(room, BakeOptions(**FEW, textures=by, vertex_ao="attribute")).vertex_ao for by in ("one", "mesh")
    )
    assert several == pytest.approx(one, abs=0.15)
    assert np.abs(several - one).mean() < 0.03


def test_formats_with_one_texture_are_refused(room, tmp_path):
    result = ao.bake(room, BakeOptions(**FEW, textures="material"))
    with pytest.raises(ArgumentError, match="refers to one texture"):
        result.save(tmp_path / "out.ply")
    assert not list(tmp_path.glob("out*"))


def test_one_texture_of_several_has_no_name_of_its_own(tmp_path):
    path = obj_room(tmp_path / "one.obj", OBJECTS[2:], ("stone",))
    files = ao.bake(path, BakeOptions(**FEW, textures="material")).save(f"{tmp_path}/out/")
    assert [texture.name for texture in files.textures] == ["one_ao.png"]


def test_textures_are_joined_with_rows_between_them():
    rng = np.random.default_rng(0)
    textures = [rng.random(shape).astype(np.float32) for shape in ((16, 16), (32, 16))]
    uvs = rng.random((8, 3, 2))
    uvs[4:] += [2, -3]  # repeats
    owners = np.arange(8) % 2
    stack = TextureStack.of([texture.shape for texture in textures], owners, uvs)
    joined, moved = stack.join(textures), stack.move(owners, uvs)
    assert joined.shape == (16 + 32 + 4 * 16, 16)
    for face, owner in enumerate(owners):
        inside = (np.abs(uvs[face] % 1 - 0.5) < 0.45).all(axis=1)
        here = bilinear(joined, moved[face], repeats=False)
        assert here[inside] == pytest.approx(bilinear(textures[owner], uvs[face], repeats=True)[inside], abs=1e-5)


# Read back.


@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_results_are_read_back_with_all_their_textures(room, tmp_path, suffix):
    (tmp_path / "out").mkdir()
    options = BakeOptions(**FEW, textures="mesh")
    result = ao.bake(room, options, verify=True)
    files = result.save(tmp_path / "out" / f"room_ao{suffix}")
    report = ao.verify(files.mesh)
    assert report.texture.triangles == len(result.mesh.faces)
    assert report.warnings == ()
    assert report.error == pytest.approx(result.report.verify.levels[0].rmse, abs=2e-3)
    assert ao.compare(files.mesh, files.mesh).difference == 0
    drawn = mesh_to_draw(files.mesh).mesh
    assert drawn.textured.all()
    assert drawn.ao == pytest.approx(result.ao, abs=0.51 / 255)
    if files.textures:
        assert mesh_beside(files.textures[0]) == files.mesh


@pytest.mark.parametrize(
    "how",
    [
        {"pack": "orm"},
        {"bent_normals": True},
        {"size": "auto", "texel_density": 8},
        {"self_occlusion": "part"},
        {"ground": True},
    ],
    ids=str,
)
def test_what_a_bake_can_do_it_does_for_several_textures(tmp_path, how):
    mesh, options = ao.load(gltf_room(tmp_path)), BakeOptions(**{**FEW, **how})
    one, several = (ao.bake(mesh, replace(options, textures=by), verify=True) for by in ("one", "material"))
    errors = [result.report.verify.levels[0].rmse for result in (one, several)]
    assert errors[1] < max(1.5 * errors[0], 0.02)
    made = several.save(tmp_path / "out.glb").mesh
    assert ao.verify(made).error == pytest.approx(errors[1], abs=3e-3)
    assert (several.bent_normals is not None) == ("bent_normals" in how)


@pytest.mark.slow
def test_pictures_of_occlusion_are_read_back_as_ao(room, tmp_path):
    result = ao.bake(room, BakeOptions(**FEW, textures="material", invert=True), verify=True)
    (tmp_path / "out").mkdir()
    made = result.save(tmp_path / "out/room_ao.png")
    assert [path.name for path in made.textures] == ["room_ao.wood.png", "room_ao.stone.png"]
    assert ao.verify(made.mesh).error == pytest.approx(result.report.verify.levels[0].rmse, abs=3e-3)


@pytest.mark.parametrize("given", ["out", "out/room_ao.obj", "out/room_ao.wood.png", "out/room_report.json"])
def test_a_page_has_one_asset_for_them(room, tmp_path, given):
    (tmp_path / "out").mkdir()
    result = ao.bake(room, BakeOptions(**FEW, textures="material"))
    result.save(tmp_path / "out/room_ao.png", report=tmp_path / "out/room_report.json")
    found = collect_assets(tmp_path / given)
    assert [(asset.name, asset.mesh.name) for asset in found] == [("room", "room_ao.obj")]


# UDIM.


def on_tiles(uvs, tile):
    return np.asarray(uvs, float) * 0.9 + 0.05 + tile


def udim_obj(path, tiles=((0, 0), (1, 0), (2, 1))):
    """An OBJ of one object and material: a floor and walls, each a quad on a tile of its own."""
    quads = [
        [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)],
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
        [(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)],
    ]
    path.with_suffix(".mtl").write_text("newmtl skin\nKd 0.8 0.8 0.8\n")
    lines = [f"mtllib {path.stem}.mtl", "o body", "usemtl skin"]
    for corners, tile in zip(quads, tiles, strict=True):
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines += [f"vt {u} {v}" for u, v in on_tiles([(0, 0), (0, 1), (1, 1), (1, 0)], tile).tolist()]
        lines.append("f -4/-4 -3/-3 -2/-2 -1/-1")
    path.write_text("\n".join(lines) + "\n")
    return path


NUMBERS = ["1001", "1002", "1013"]


def test_tiles_stay_tiles_in_an_obj(tmp_path):
    path = udim_obj(tmp_path / "body.obj")
    result = ao.bake(path, BakeOptions(**FEW), verify=True)
    assert [texture.name for texture in result.textures] == NUMBERS
    assert result.report.unwrap.method == "keep"
    assert result.report.verify.levels[0].rmse < 0.03
    files = result.save(f"{tmp_path}/out/")
    assert [picture.name for picture in files.textures] == [f"body_ao.{number}.png" for number in NUMBERS]
    text = files.mesh.read_text()
    assert [line for line in text.splitlines() if line[:3] == "vt "] == [
        line for line in path.read_text().splitlines() if line[:3] == "vt "
    ]
    assert [line for line in text.splitlines() if line[:6] == "usemtl"] == [f"usemtl skin_{n}" for n in NUMBERS]
    assert ao.verify(files.mesh).error == pytest.approx(result.report.verify.levels[0].rmse, abs=2e-3)


def test_tiles_stay_tiles_in_a_gltf(tmp_path):
    """A primitive becomes one for each tile; vertices and UVs stay, beyond [0, 1], and samplers repeat."""
    plain, maker = load_scene(udim_obj(tmp_path / "body.obj")), GltfMaker(tmp_path)
    normals = np.repeat(face_normals(plain.corners)[0], 3, axis=0)
    uvs = plain.uvs.reshape(-1, 2) * (1, -1) + (0, 1)
    attributes = {
        "POSITION": maker.vertices(plain.corners.reshape(-1, 3).astype("<f4"), bounds=True),
        "NORMAL": maker.vertices(normals.astype("<f4")),
        "TEXCOORD_0": maker.vertices(uvs.astype("<f4")),
    }
    indices = maker.accessor(np.arange(len(uvs), dtype="<u2"))
    material = maker.add("materials", {"name": "skin"})
    maker.node(mesh=maker.mesh({"attributes": attributes, "indices": indices, "material": material}))
    path = maker.save("body.glb")
    result = ao.bake(path, BakeOptions(**FEW), verify=True)
    files = result.save(tmp_path / "out.glb")
    document = pygltflib.GLTF2().load(files.mesh)
    primitives = document.meshes[0].primitives
    assert [document.materials[each.material].name for each in primitives] == ["skin", "skin_1002", "skin_1013"]
    assert len({each.attributes.POSITION for each in primitives}) == 1
    samplers = {document.samplers[texture.sampler].wrapS for texture in document.textures[1:]}
    assert samplers == {pygltflib.REPEAT}
    assert load_scene(files.mesh).uvs == pytest.approx(load_scene(path).uvs)
    assert ao.verify(files.mesh).error == pytest.approx(result.report.verify.levels[0].rmse, abs=2e-3)


@needs_validator
def test_the_validator_accepts_tiles(tmp_path):
    files = ao.bake(udim_obj(tmp_path / "body.obj"), BakeOptions(**FEW)).save(tmp_path / "out.glb")
    assert issues(files.mesh) == [[]]


@pytest.mark.parametrize(
    ("tiles", "why"),
    [
        (((0, 0), (0, 0), (0, 0)), "overlap within a tile"),
        (((0, 0), (0.5, 0), (2, 0)), "a face crosses a border"),
        (((0, 0), (-1, 0), (1, 0)), "a tile without a number"),
        (((0, 0), (10, 0), (1, 0)), "a column beyond the last"),
    ],
)
def test_other_uvs_make_one_texture(tmp_path, tiles, why):
    result = ao.bake(udim_obj(tmp_path / "body.obj", tiles), BakeOptions(**FEW))
    assert [texture.name for texture in result.textures] == [""], why
    assert result.report.unwrap.method == "xatlas"


def test_new_uvs_are_not_on_tiles(tmp_path):
    result = ao.bake(udim_obj(tmp_path / "body.obj"), BakeOptions(**FEW, unwrap="xatlas"))
    assert len(result.textures) == 1
