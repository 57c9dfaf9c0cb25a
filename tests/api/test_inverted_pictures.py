"""Pictures of the occlusion, 1 - AO: what is in them, and that every reader gives AO back."""

import json

import numpy as np
import OpenImageIO
import pytest
import trimesh
from PIL import Image

import aoprecalc as ao
from aoprecalc.api.report_assets import AssetFiles
from aoprecalc.api.report_contents import read_asset
from aoprecalc.errors import UsageError
from aoprecalc.io import find_occlusion, load_scene
from api.test_several_textures import udim_obj
from shapes import join, quad, torus

SMALL = {"size": 64, "directions": 64, "backend": "ray", "threads": 1}
MEASURED = ao.VerifyOptions(points=500, rays=64, threads=1)
DRAWN = ao.PreviewOptions(size=(64, 48), backend="ray", threads=1)
STEPS = {".png": 1 / 255, ".jpg": 12 / 255, ".tif": 1 / 255, ".tga": 1 / 255, ".bmp": 1 / 255, ".exr": 1 / 1024}


@pytest.fixture(scope="module")
def ring():
    return ao.Mesh(*join(torus(around=16, across=8), quad((-2, -2, -0.5), (4, 0, 0), (0, 4, 0), 2)), name="ring")


@pytest.fixture(scope="module")
def bakes(ring):
    """The bakes without and with `invert`."""
    return [ao.bake(ring, ao.BakeOptions(**SMALL, invert=invert)) for invert in (False, True)]


def stored(path):
    """The first channel as another program reads it, in [0, 1]."""
    buffer = OpenImageIO.ImageBuf(str(path))
    return buffer.get_pixels(OpenImageIO.FLOAT)[:, :, 0]


def test_in_memory_it_stays_ambient_occlusion(bakes):
    plain, inverted = bakes
    assert np.array_equal(plain.ao, inverted.ao)
    assert np.array_equal(plain.preview(DRAWN), inverted.preview(DRAWN))
    assert plain.ao.min() < 0.5


@pytest.mark.parametrize("suffix", STEPS)
def test_every_texel_is_the_complement(bakes, tmp_path, suffix):
    plain, inverted = (
        stored(result.save(tmp_path / f"{number}{suffix}").texture) for number, result in enumerate(bakes)
    )
    assert np.abs(plain + inverted - 1).max() <= STEPS[suffix]
    assert inverted.max() > 0.5


@pytest.mark.parametrize("depth", ["8", "16"])
def test_pillow_reads_the_complement(bakes, tmp_path, depth):
    top = 255 if depth == "8" else 65535
    result = ao.bake(bakes[0].mesh, ao.BakeOptions(**SMALL, invert=True, bit_depth=depth, unwrap="keep"))
    picture = np.asarray(Image.open(result.save(tmp_path / "a.png").texture), float)
    assert np.abs(picture - top * (1 - result.ao.astype(float))).max() <= 0.51


def test_what_is_not_filled_is_closed_as_without(ring, tmp_path):
    """AO has 0 there, so that the picture has 1: each texel is the complement."""
    result = ao.bake(ring, ao.BakeOptions(**SMALL, fill="none", padding=0, invert=True))
    picture = np.asarray(Image.open(result.save(tmp_path / "a.png").texture))
    empty = ~result.valid & (result.ao == 0)
    assert empty.mean() > 0.1
    assert (picture[empty] == 255).all()


@pytest.mark.parametrize("kind", ["glb", "gltf", "obj", "ply"])
def test_verify_preview_and_compare_give_the_same_as_without(bakes, tmp_path, kind):
    reports, pictures, files = [], [], []
    for name, result in zip(("plain", "inverted"), bakes, strict=True):
        saved = result.save(tmp_path / f"{name}.png", mesh_output=tmp_path / f"{name}.{kind}")
        files.append(saved)
        of_mesh = ao.verify(saved.mesh, options=MEASURED)
        reports.append([of_mesh, ao.verify(saved.mesh, saved.texture, options=MEASURED)])
        pictures += [ao.preview(saved.mesh, DRAWN).image, ao.preview(saved.texture, DRAWN).image]
    for plain, inverted in zip(*reports, strict=True):
        assert inverted.options == plain.options
        assert inverted.levels[0].rmse == pytest.approx(plain.levels[0].rmse, abs=2e-4)
        assert inverted.levels[0].bias == pytest.approx(plain.levels[0].bias, abs=2e-4)
    for picture in pictures[1:]:
        assert np.abs(picture.astype(int) - pictures[0]).max() <= 2
    plain, inverted = files
    assert ao.compare(plain.texture, inverted.texture).difference <= 1 / 255
    assert ao.compare(plain.mesh, inverted.mesh).difference <= 1 / 255
    reference = find_occlusion(load_scene(inverted.mesh)).values
    assert np.abs(reference - bakes[1].ao).max() <= 0.51 / 255


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_the_materials_have_no_colour_of_it(bakes, tmp_path, kind):
    """The mesh refers to the other picture, which is no colour of its own."""
    saved = bakes[1].save(tmp_path / "ring.png", mesh_output=tmp_path / f"ring.{kind}")
    material = ao.PreviewOptions(size=(64, 48), backend="ray", threads=1, shading="material")
    same = [ao.preview(path, material).image for path in (saved.mesh, saved.texture)]
    assert np.array_equal(*same)


def test_the_mesh_has_a_picture_of_ambient_occlusion(bakes, tmp_path):
    """Another reader, which knows nothing of inversion."""
    bakes[1].save(tmp_path / "a.png", mesh_output=tmp_path / "a.gltf", report=tmp_path / "a.json")
    document = json.loads((tmp_path / "a.gltf").read_text())
    (image,) = document["images"]
    assert image["uri"] == "a_open.png"
    assert np.abs(stored(tmp_path / "a_open.png") - bakes[1].ao).max() <= 0.51 / 255
    report = json.loads((tmp_path / "a.json").read_text())
    assert report["outputs"]["inverted"] is True
    assert str(tmp_path / "a_open.png") in report["outputs"]["others"]
    assert any("holds the occlusion, 1 - AO" in line for line in report["notes"])
    bakes[1].save(tmp_path / "b.png", mesh_output=tmp_path / "b.glb")
    (material,) = [one.visual.material for one in trimesh.load(tmp_path / "b.glb").geometry.values()]
    inside = np.asarray(material.occlusionTexture)
    assert np.abs(inside / 255 - bakes[1].ao).max() <= 0.51 / 255
    assert not (tmp_path / "b_open.png").exists()


def test_a_mesh_alone_is_refused(bakes, tmp_path):
    for name in ("a.glb", "a.gltf", "a.obj", "a.ply"):
        with pytest.raises(UsageError, match="names a mesh alone") as caught:
            bakes[1].save(tmp_path / name)
        assert "invert" in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_pictures_that_cannot_say_so_are_told(bakes, tmp_path):
    reports = []
    for name in ("a.tga", "a.png"):
        bakes[1].save(tmp_path / name, report=tmp_path / "a.json")
        reports.append(json.loads((tmp_path / "a.json").read_text())["warnings"])
    assert [any("cannot say that it is inverted" in line for line in lines) for lines in reports] == [True, False]


@pytest.mark.slow
def test_bake_verify_measures_what_was_written(command, tmp_path):
    trimesh.Trimesh(*torus(around=16, across=8), process=False).export(tmp_path / "ring.ply")
    errors = []
    for name, more in (("plain", ()), ("tga", ("--invert",))):
        out = tmp_path / name / ("ring_ao.tga" if name == "tga" else "ring_ao.png")
        out.parent.mkdir()
        words = ("--size", 64, "-n", 64, "--backend", "ray", "--verify", "--json", *more)
        done = command("bake", tmp_path / "ring.ply", "-o", out, *words)
        assert done.returncode == 0, done.stderr
        errors.append(json.loads(done.stdout)["verify"]["levels"][0]["rmse"])
    assert max(errors) - min(errors) < 2e-4


def test_a_report_of_the_picture_shows_ambient_occlusion(bakes, tmp_path):
    saved = bakes[1].save(tmp_path / "ring_ao.png")
    for texture, mesh in ((saved.texture, None), (saved.texture, saved.mesh)):
        read = read_asset(AssetFiles("ring", texture=texture, mesh=mesh))
        assert np.abs(read.ao - bakes[1].ao).max() <= 0.51 / 255


@pytest.mark.slow
def test_a_batch_inverts(command, tmp_path):
    trimesh.Trimesh(*torus(around=12, across=6), process=False).export(tmp_path / "ring.ply")
    text = '[bake]\nsize = 32\ndirections = 64\nbackend = "ray"\ninvert = true\nstrength = 0.5\n'
    (tmp_path / "batch.toml").write_text(f'inputs = ["ring.ply"]\noutput = "out"\n{text}')
    done = command("batch", tmp_path / "batch.toml")
    assert done.returncode == 0, done.stderr
    names = sorted(path.name for path in (tmp_path / "out").iterdir() if path.suffix in (".png", ".ply"))
    assert names == ["ring_ao.ply", "ring_ao.png", "ring_ao_open.png"]


@pytest.mark.parametrize(("suffix", "several"), [(".png", False), (".tga", False), (".png", True), (".tga", True)])
def test_messages_count_the_pictures(ring, tmp_path, suffix, several):
    mesh = ring
    if several:
        mesh = udim_obj(tmp_path / "ring.obj")
    made = ao.bake(mesh, ao.BakeOptions(**SMALL, invert=True))
    files = made.save(tmp_path / f"out{suffix}", mesh_output=tmp_path / "out.obj", report=tmp_path / "out.json")
    report = json.loads((tmp_path / "out.json").read_text())
    (note,) = [line for line in report["notes"] if "1 - AO" in line]
    warnings = [line for line in report["warnings"] if "inverted" in line]
    if several:
        first, others = f"{files.textures[0]} and 2 others", "out_open.1001.png and 2 others"
        assert note == f"{first} hold the occlusion, 1 - AO; {files.mesh} refers to {others}, of the AO"
        expected = f"{first} cannot say that they are inverted: other commands will take them for AO; write a .png"
    else:
        assert note == f"{files.texture} holds the occlusion, 1 - AO; {files.mesh} refers to out_open.png, of the AO"
        expected = f"{files.texture} cannot say that it is inverted: other commands will take it for AO; write a .png"
    assert warnings == ([expected] if suffix == ".tga" else [])


@pytest.mark.slow
def test_the_command_says_that_a_picture_is_inverted(command, tmp_path):
    trimesh.Trimesh(*torus(around=12, across=6), process=False).export(tmp_path / "ring.ply")
    words = "bake", tmp_path / "ring.ply", "-o", tmp_path / "out.png", "--size", 32, "-n", 64, "--backend", "ray"
    lines = [command(*words, *more).stdout.splitlines()[0] for more in ((), ("--invert",))]
    assert ["32 x 32, inverted (1 - AO), mean AO" in line for line in lines] == [False, True]
