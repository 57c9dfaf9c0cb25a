"""What `-o` may name, what is written then, and where the texture went."""

import io
import json

import numpy as np
import pygltflib
import pytest
from PIL import Image

import aoprecalc as ao
from aoprecalc import options
from aoprecalc.io import (
    IMAGE_EXTENSIONS,
    MESH_EXTENSIONS,
    OUTPUT_MESH_EXTENSIONS,
    images,
    load_scene,
    meshes,
    sphere_files,
)
from aoprecalc.io.occlusion import find_occlusion
from aoprecalc.options import BAKED_MESH_EXTENSIONS, SPHERE_EXTENSIONS
from gltf_kit.gltf_documents import APART, corner
from gltf_kit.gltf_maker import GltfMaker
from pipeline.helpers import write_ring
from shapes import torus

QUICK = ["--size", "32", "-n", "64"]


@pytest.fixture
def ring(tmp_path):
    return write_ring(tmp_path / "ring.obj")


def made(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def embedded(path):
    """The picture of the occlusion texture inside a GLB, through pygltflib and Pillow."""
    document = pygltflib.GLTF2().load(str(path))
    texture = document.textures[document.materials[0].occlusionTexture.index]
    view = document.bufferViews[document.images[texture.source].bufferView]
    data = document.binary_blob()[view.byteOffset or 0 :][: view.byteLength]
    return np.asarray(Image.open(io.BytesIO(data)))


# -o ... -> the files that appear
OUTPUTS = {
    "b_ao.png": ["b_ao.mtl", "b_ao.obj", "b_ao.png"],
    "b_ao.EXR": ["b_ao.EXR", "b_ao.mtl", "b_ao.obj"],
    "car.glb": ["car.glb"],
    "car.gltf": ["car.bin", "car.gltf", "car_ao.png"],
    "car.obj": ["car.mtl", "car.obj", "car_ao.png"],
    "car_ao.obj": ["car_ao.mtl", "car_ao.obj", "car_ao.png"],
    "car.ply": ["car.ply", "car_ao.png"],
    "made/": ["made/ring_ao.mtl", "made/ring_ao.obj", "made/ring_ao.png"],
    "t.tif car.ply": ["car.ply", "t.tif"],
    "car.glb t.png": ["car.glb", "t.png"],
    "made/ car.glb": ["car.glb", "made/ring_ao.png"],
    "t.exr car.gltf": ["car.bin", "car.gltf", "t.exr", "t.png"],  # glTF allows no EXR
    "t.png --mesh-output made/": ["made/t.mtl", "made/t.obj", "t.png"],
    "t.png --mesh-output car.ply": ["car.ply", "t.png"],
}


@pytest.mark.parametrize("given", OUTPUTS)
def test_what_is_written(given, ring, tmp_path, run):
    (tmp_path / "made").mkdir()
    files, *more = given.split(" --mesh-output ")
    words = [word for name in files.split() for word in ("-o", name)]
    done = run(tmp_path, "bake", "ring.obj", *QUICK, *words, *(["--mesh-output", *more] if more else []), "--json")
    assert done.returncode == 0, done.stderr
    assert made(tmp_path) == sorted(["ring.obj", *OUTPUTS[given]])
    outputs = json.loads(done.stdout)["outputs"]
    named = [outputs["texture"], outputs["mesh"], *outputs["others"]]
    assert sorted(filter(None, named)) == OUTPUTS[given]
    assert (outputs["texture"] is None) == (given == "car.glb")
    mesh = load_scene(tmp_path / outputs["mesh"])
    texture = find_occlusion(mesh)  # as verify finds it
    assert texture.values.shape == (32, 32)
    assert texture.shown.all()


def test_the_texture_inside_a_glb_is_the_one_that_stands_beside_others(ring, tmp_path, run):
    for output in ("alone.glb", "plain.png"):
        assert run(tmp_path, "bake", "ring.obj", *QUICK, "-o", output).returncode == 0
    assert np.array_equal(embedded(tmp_path / "alone.glb"), np.asarray(Image.open(tmp_path / "plain.png")))
    done = run(tmp_path, "verify", "alone.glb", "--points", "200", "--rays", "64", "--tolerance", "0.5")
    assert done.returncode == 0, done.stderr


def test_sixteen_bits_fit_into_a_glb(ring, tmp_path, run):
    assert run(tmp_path, "bake", "ring.obj", *QUICK, "-o", "car.glb", "--bit-depth", "16").returncode == 0
    assert embedded(tmp_path / "car.glb").max() > 255


def test_what_is_measured_is_the_texture_inside(ring, tmp_path, run):
    done = run(tmp_path, "bake", "ring.obj", *QUICK, "-o", "car.glb", "--verify", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["verify"]["levels"][0]["rmse"] < 0.2


WRONG = {
    "two images": ("a.png a.exr", "names the images a.png and a.exr; expected one image, one mesh or both"),
    "two meshes": ("a.obj b.glb", "names the meshes a.obj and b.glb"),
    "three": ("a.png b.glb c.ply", "names the meshes b.glb and c.ply"),
    "a mesh without UVs": ("a.stl", "a.stl: the extension .stl is neither that of an image"),
    "no extension": ("a", "a: a name without extension is neither that of an image"),
    "two names of the mesh": (
        "car.glb --mesh-output b.obj",
        "--mesh-output is b.obj, but --output names the mesh car.glb",
    ),
    "a folder for it": ("car.glb --mesh-output made/", "--mesh-output is made/, but --output names the mesh car.glb"),
    "a depth that the image inside lacks": ("car.glb --bit-depth half", "--bit-depth is half, but the texture inside"),
    "a depth that the image beside lacks": ("car.obj --bit-depth float", "car_ao.png: .png has no bit depth float"),
    "a packing that the mesh lacks": ("car.ply --pack orm", "--pack is orm, which needs .gltf or .glb"),
    "the mesh beside it is the input": ("ring.png", "ring.obj: belongs to the input itself"),
    "the same name twice": ("a.png --report a.png", "two outputs have this name"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_is_said_before_the_work(name, ring, tmp_path, run, monkeypatch):
    monkeypatch.setattr("aoprecalc.api.bake.bake_textures", None)  # calling it would fail
    given, message = WRONG[name]
    files, *more = given.split(" --", 1)
    words = [word for file in files.split() for word in ("-o", file)]
    done = run(tmp_path, "bake", "ring.obj", *QUICK, *words, *(f"--{more[0]}".split() if more else []))
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert made(tmp_path) == ["ring.obj"]


def test_a_texture_of_the_input_is_refused_before_the_work(tmp_path, run, monkeypatch):
    monkeypatch.setattr("aoprecalc.api.bake.bake_textures", None)
    maker = GltfMaker(tmp_path)
    (tmp_path / "paint.png").write_bytes(b"mine")
    texture = maker.add("textures", {"source": maker.add("images", {"uri": "paint.png"})})
    material = maker.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    maker.node(mesh=maker.mesh(corner(maker, APART, material=material)))
    maker.save("wall.gltf", "wall.bin")
    done = run(tmp_path, "bake", "wall.gltf", *QUICK, "-o", "paint.png")
    assert done.returncode == 2
    assert "paint.png: belongs to the input itself" in done.stderr
    assert (tmp_path / "paint.png").read_bytes() == b"mine"


def test_python_saves_the_same_files(tmp_path):
    result = ao.bake(ao.Mesh(*torus(around=16, across=8), name="ring"), ao.BakeOptions(size=32, directions=64))
    files = result.save(tmp_path / "car.glb", report=tmp_path / "report.json")
    assert (files.texture, files.mesh) == (None, tmp_path / "car.glb")
    outputs = json.loads((tmp_path / "report.json").read_text())["outputs"]
    assert (outputs["texture"], outputs["mesh"]) == (None, str(tmp_path / "car.glb"))
    assert outputs["references"][0] == {
        "slot": "occlusionTexture", "materials": 1, "uvs": "TEXCOORD_0", "packed": False, "strength": 1.0,
    }  # fmt: skip
    assert made(tmp_path) == ["car.glb", "report.json"]
    files = result.save(tmp_path / "car.obj")
    assert (files.texture, files.mesh) == (tmp_path / "car_ao.png", tmp_path / "car.obj")
    with pytest.raises(ao.UsageError, match=r"mesh_output is b\.ply, but output names the mesh"):
        result.save("car.glb", mesh_output="b.ply")


# Where the texture went.


def last_line(done):
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


PLACES = {
    "a.glb": "occlusionTexture and baseColorTexture of 1 material, TEXCOORD_0 (new UVs by xatlas)",
    "a.obj": "map_Kd of 1 material, vt (new UVs by xatlas)",
    "a.ply": "TextureFile, s and t (new UVs by xatlas)",
}


@pytest.mark.parametrize("output", PLACES)
def test_the_last_line_says_where_the_texture_is(output, ring, tmp_path, run):
    assert last_line(run(tmp_path, "bake", "ring.obj", *QUICK, "--unwrap", "xatlas", "-o", output)) == PLACES[output]


def test_a_material_with_a_color_texture_gets_map_ka(tmp_path, run):
    mtl = "newmtl plain\nKd 1 1 1\nnewmtl painted\nmap_Kd paint.png\n"
    (tmp_path / "quads.mtl").write_text(mtl)
    faces = ["usemtl plain\nf 1/1 2/2 3/3 4/4\n", "usemtl painted\nf 5/5 6/6 7/7 8/8\n"]
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    lines = [f"v {x} {y} {z}\n" for z in (0, 1) for x, y in corners]
    lines += [f"vt {(x + z) / 2} {y}\n" for z in (0, 1) for x, y in corners]
    (tmp_path / "quads.obj").write_text("mtllib quads.mtl\n" + "".join(lines + faces))
    done = run(tmp_path, "bake", "quads.obj", *QUICK, "-o", "a.obj", "--padding", "0")
    assert last_line(done) == "map_Kd and map_Ka of 1 material, vt (the file's own UVs)"


def gltf_of(folder, *materials, **members):
    """A GLB with a corner of each material, on UVs that hold no bake where there are several of them."""
    maker = GltfMaker(folder)
    for at, material in enumerate(materials):
        number = maker.add("materials", material)
        maker.node(mesh=maker.mesh(corner(maker, APART, material=number, **members)), translation=[0, 0, 9 * at])
    maker.save("model.glb")
    return maker


def test_materials_and_new_uvs_of_a_gltf_are_counted(tmp_path, run):
    gltf_of(tmp_path, {}, {"name": "b"}, {"name": "c"})
    done = run(tmp_path, "bake", "model.glb", *QUICK, "-o", "a.glb")
    assert last_line(done) == "occlusionTexture of 3 materials, TEXCOORD_1 (new UVs by xatlas)"


def test_kept_uvs_and_a_single_material(tmp_path, run):
    gltf_of(tmp_path, {})
    done = run(tmp_path, "bake", "model.glb", *QUICK, "-o", "a.glb")
    assert last_line(done) == "occlusionTexture of 1 material, TEXCOORD_0 (the file's own UVs)"


def test_a_doubled_material_counts_once(tmp_path, run):
    """The part that is not baked keeps the material, the baked one gets a copy."""
    maker = GltfMaker(tmp_path)
    material = maker.add("materials", {"name": "shared"})
    for name in ("baked", "other"):
        maker.node(mesh=maker.mesh(corner(maker, APART, material=material)), name=name)
    maker.save("model.glb")
    done = run(tmp_path, "bake", "model.glb", *QUICK, "-o", "a.glb", "--only", "baked")
    assert last_line(done).startswith("occlusionTexture of 1 material, TEXCOORD_")
    document = pygltflib.GLTF2().load(str(tmp_path / "a.glb"))
    assert [material.occlusionTexture is not None for material in document.materials] == [False, True]


def test_a_packed_texture_is_told_apart(tmp_path, run):
    maker = GltfMaker(tmp_path)
    texture = maker.texture(np.full((8, 8, 3), 99, np.uint8))
    rough = maker.add("materials", {"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": texture}}})
    maker.node(mesh=maker.mesh(corner(maker, APART, material=rough)))
    maker.save("model.glb")
    done = run(tmp_path, "bake", "model.glb", *QUICK, "-o", "a.glb", "--pack", "orm", "--json")
    expected = {"slot": "occlusionTexture", "materials": 1, "uvs": "TEXCOORD_0", "packed": True, "strength": 1.0}
    assert json.loads(done.stdout)["outputs"]["references"] == [expected]
    done = run(tmp_path, "bake", "model.glb", *QUICK, "-o", "a.glb", "--pack", "orm")
    places = "occlusionTexture of 1 material, with roughness and metalness, TEXCOORD_0 (the file's own UVs)"
    assert last_line(done) == places


# The extensions that help texts name.


def test_help_and_docstrings_name_the_formats_that_there_are():
    assert options.IMAGE_EXTENSIONS == IMAGE_EXTENSIONS == tuple(images.BIT_DEPTHS)
    assert options.MESH_EXTENSIONS == MESH_EXTENSIONS
    assert (
        BAKED_MESH_EXTENSIONS
        == OUTPUT_MESH_EXTENSIONS
        == tuple(extension for extension in MESH_EXTENSIONS if meshes.format_of(f"a{extension}").writes)
    )
    assert SPHERE_EXTENSIONS == sphere_files.SPHERE_EXTENSIONS
    for extensions, text in (
        (BAKED_MESH_EXTENSIONS, ao.BakeResult.save.__doc__),
        (IMAGE_EXTENSIONS, ao.BakeResult.save.__doc__),
        (SPHERE_EXTENSIONS, ao.SphereResult.save.__doc__),
    ):
        assert " ".join(extensions) in " ".join(text.split())


@pytest.mark.parametrize("name", ["bake", "spheres"])
def test_no_list_of_extensions_stays_a_placeholder(name, run, tmp_path):
    done = run(tmp_path, name, "--help")
    assert done.returncode == 0
    assert "{" not in done.stdout
