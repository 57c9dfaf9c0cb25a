"""What a written glTF says of pictures of bent normals and spherical harmonics, found again as readers find them."""

import base64
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.io.images import read_pixels
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import issues, needs_validator
from gltf_kit.gltf_values import GltfValues
from shapes import box, quad

ROOT = Path(__file__).parents[2]
THREE = ROOT / "viewer/node_modules/three"

FAST = {"size": 32, "directions": 32, "backend": "ray"}
BENT, HARMONICS = "bentNormalTexture", "sphericalHarmonicsTexture"
SHAPES = {"wood": box(), "stone": quad((-2, -0.05, 3), (6, 0, 0), (0, 0, -6), 4)}


def room(folder, **extras):
    """A GLB of two meshes with a material each, which have these extras."""
    maker = GltfMaker(folder)
    for name, (positions, faces) in SHAPES.items():
        corners = np.asarray(positions, "<f4")[np.asarray(faces).ravel()]
        said = {"extras": extras[name]} if name in extras else {}
        material = maker.add("materials", {"name": name, **said})
        attributes = {"POSITION": maker.vertices(corners, bounds=True)}
        mesh = maker.mesh({"attributes": attributes, "material": material})
        maker.json["meshes"][mesh]["name"] = name
        maker.node(mesh=mesh)
    return maker.save("room.glb")


def baked(source, output, **options):
    """Bake both kinds of pictures beside a mesh, bent.png and sh.png."""
    folder = output.parent
    made = ao.bake(source, BakeOptions(**{**FAST, "bent_normals": True, **options}))
    return made.save(output, bent_normals=folder / "bent.png", sh=folder / "sh.png")


def named(path):
    """(material, name) -> the bytes of the picture that it names, and what else it says."""
    values = GltfValues(path)
    return {
        (material["name"], name): (values.texture(info["index"])["source"][0], {**info, "index": None})
        for material in values.json["materials"]
        for name, info in material.get("extras", {}).get("aoprecalc", {}).items()
    }


def pictures(path):
    """The files of all images of a document."""
    values = GltfValues(path)
    return [values.image(number)[0] for number in range(len(values.json["images"]))]


@pytest.mark.parametrize("by", ["one", "material"])
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_each_material_names_its_pictures(tmp_path, by, suffix):
    files = baked(room(tmp_path), tmp_path / f"out{suffix}", textures=by, bent_space="object", green="down")
    found = named(files.mesh)
    for name, paths in ((BENT, files.bent_normals), (HARMONICS, files.sh)):
        assert len(paths) == (1 if by == "one" else 2)
        for material, path in zip(SHAPES, paths * (3 - len(paths)), strict=True):
            data, said = found[material, name]
            assert data == path.read_bytes()
            slot = next(one for one in GltfValues(files.mesh).json["materials"] if one["name"] == material)
            assert said == {
                "index": None,
                "texCoord": slot["occlusionTexture"]["texCoord"],
                "space": "object",
                "green": "down",
            }
    assert len(found) == 4
    assert len(pictures(files.mesh)) == 3 * (1 if by == "one" else 2)


def test_a_gltf_refers_to_the_pictures_that_were_asked_for(tmp_path):
    files = baked(room(tmp_path), tmp_path / "out.gltf")
    uris = [image["uri"] for image in json.loads(files.mesh.read_text())["images"]]
    assert uris == ["out_ao.png", "bent.png", "sh.png"]


def test_the_report_tells_where(tmp_path):
    result = ao.bake(room(tmp_path), BakeOptions(**FAST, bent_normals=True))
    result.save(tmp_path / "out.glb", bent_normals=tmp_path / "bent.png", report=tmp_path / "r.json")
    uses = json.loads((tmp_path / "r.json").read_text())["outputs"]["references"]
    assert [(use["slot"], use["materials"], use["uvs"]) for use in uses] == [
        ("occlusionTexture", 2, "TEXCOORD_0"),
        ("extras.aoprecalc.bentNormalTexture", 2, "TEXCOORD_0"),
    ]


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_what_gltf_does_not_allow_it_gets_as_png(tmp_path, suffix):
    """EXR holds the components themselves, the copy 0.5 v + 0.5; a reserved name is left to whom it is for."""
    result = ao.bake(room(tmp_path), BakeOptions(**FAST, bent_normals=True))
    files = result.save(tmp_path / f"out{suffix}", bent_normals=tmp_path / "sh.png", sh=tmp_path / "sh.exr")
    data, _ = named(files.mesh)["wood", HARMONICS]
    (tmp_path / "copy.png").write_bytes(data)
    found, exact = read_pixels(tmp_path / "copy.png"), read_pixels(tmp_path / "sh.exr")
    assert found[..., 0] == pytest.approx(exact[..., 0], abs=0.003)
    assert 2 * found[..., 1:] - 1 == pytest.approx(exact[..., 1:], abs=0.006)
    assert named(files.mesh)["wood", BENT][0] == (tmp_path / "sh.png").read_bytes()
    assert (tmp_path / "sh_1.png").exists() == (suffix == ".gltf")


def test_the_next_bake_replaces_them(tmp_path):
    first = baked(room(tmp_path), tmp_path / "first.glb").mesh
    (tmp_path / "second").mkdir()
    second = baked(first, tmp_path / "second/room.glb", seed=1, directions=64)
    assert named(second.mesh)["stone", BENT][0] == second.bent_normals[0].read_bytes()
    third = ao.bake(second.mesh, BakeOptions(**FAST)).save(tmp_path / "third.glb").mesh
    assert [len(pictures(path)) for path in (first, second.mesh, third)] == [3, 3, 1]
    assert all("extras" not in material for material in GltfValues(third).json["materials"])


def test_those_of_other_materials_stay(tmp_path):
    """Their textures get other numbers, as those before them go."""
    first = baked(room(tmp_path), tmp_path / "first.glb", textures="material")
    before = named(first.mesh)
    second = ao.bake(first.mesh, BakeOptions(**FAST, only=("wood",))).save(tmp_path / "second.glb").mesh
    assert named(second) == {key: value for key, value in before.items() if key[0] == "stone"}
    numbers = [
        GltfValues(path).json["materials"][1]["extras"]["aoprecalc"][BENT]["index"] for path in (first.mesh, second)
    ]
    assert numbers[0] != numbers[1]


def test_other_extras_stay(tmp_path):
    source = room(tmp_path, wood={"mine": [1], "aoprecalc": {"other": 2}}, stone="text")
    result = ao.bake(source, BakeOptions(**FAST, bent_normals=True))
    result.save(tmp_path / "out.glb", bent_normals=tmp_path / "bent.png", report=tmp_path / "r.json")
    wood, stone = (material["extras"] for material in GltfValues(tmp_path / "out.glb").json["materials"])
    assert wood["mine"] == [1]
    assert set(wood["aoprecalc"]) == {"other", BENT}
    assert stone == "text"
    said = json.loads((tmp_path / "r.json").read_text())["warnings"]
    assert any("1 material has extras that are no object" in line for line in said)


def test_numbers_that_other_programs_have_broken_harm_nothing(tmp_path):
    source = room(tmp_path, wood={"aoprecalc": {BENT: {"index": 7}}}, stone={"aoprecalc": {BENT: {"index": "x"}}})
    made = ao.bake(source, BakeOptions(**FAST)).save(tmp_path / "out.glb").mesh
    assert named(made) == {}


def test_tiles_name_each_its_own(tmp_path):
    corners = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)]
    lines = [f"v {x} {y + height} {z}" for height in (0, 1) for x, y, z in corners]
    lines += [f"vt {u + tile} {v}" for tile in (0, 1) for u, v in ((0.1, 0.1), (0.1, 0.9), (0.9, 0.9), (0.9, 0.1))]
    (tmp_path / "tiles.obj").write_text("\n".join([*lines, "f 1/1 2/2 3/3 4/4", "f 5/5 6/6 7/7 8/8"]) + "\n")
    files = baked(tmp_path / "tiles.obj", tmp_path / "out.glb")
    assert [path.name for path in files.bent_normals] == ["bent.1001.png", "bent.1002.png"]
    found = [data for (_, name), (data, _) in named(files.mesh).items() if name == BENT]
    assert found == [path.read_bytes() for path in files.bent_normals]


def test_the_same_input_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        baked(room(tmp_path), tmp_path / name / "out.glb", textures="material")
    assert (tmp_path / "a/out.glb").read_bytes() == (tmp_path / "b/out.glb").read_bytes()


@needs_validator
def test_the_validator_knows_no_use_of_them_and_finds_nothing_else(tmp_path):
    """What it cannot know is information: textures that extras name, tangents without a normal map."""
    files = baked(room(tmp_path), tmp_path / "out.glb", textures="material")
    values = GltfValues(files.mesh)
    said = [material["extras"]["aoprecalc"] for material in values.json["materials"]]
    unused = {f"/textures/{one[name]['index']}" for one in said for name in (BENT, HARMONICS)}
    found = issues(files.mesh)[0]
    assert {issue["pointer"] for issue in found if issue["code"] == "UNUSED_OBJECT"} == unused
    assert {issue["code"] for issue in found} == {"UNUSED_OBJECT", "UNUSED_MESH_TANGENT"}
    assert {issue["severity"] for issue in found} == {2}


@pytest.mark.slow
@pytest.mark.skipif(
    not (shutil.which("node") and THREE.is_dir()), reason="needs node, and three.js from scripts/setup-viewer"
)
def test_three_finds_them(tmp_path):
    files = baked(room(tmp_path), tmp_path / "out.glb", textures="material")
    command = ["node", ROOT / "tests/gltf_kit/named_textures.mjs", THREE, files.mesh]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout)
    for number, material in enumerate(SHAPES):
        for name, paths in ((BENT, files.bent_normals), (HARMONICS, files.sh)):
            texture = found[material][name]
            assert base64.b64decode(texture.pop("file")) == paths[number].read_bytes()
            assert texture == {"flipY": False, "colorSpace": "", "channel": 0, "space": "tangent", "green": "up"}
