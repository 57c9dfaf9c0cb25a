"""The strength of occlusion in glTF: what is written, that pictures keep the whole AO, and that previews apply it."""

import json

import numpy as np
import pygltflib
import pytest

import aoprecalc as ao
from aoprecalc.api.bake import bake_file
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.errors import ArgumentError
from aoprecalc.render.view_geometry import view_geometry
from gltf_kit.gltf_validator import needs_validator, new_issues
from shapes import join, quad, torus

SMALL = {"size": 64, "directions": 64, "backend": "ray", "threads": 1}
DRAWN = ao.PreviewOptions(size=(64, 48), backend="ray", threads=1)


@pytest.fixture(scope="module")
def bakes():
    """strength -> a bake of a ring above a floor with that strength."""
    shape = join(torus(around=16, across=8), quad((-2, -2, -0.5), (4, 0, 0), (0, 4, 0), 2))
    ring = ao.Mesh(*shape, name="ring")
    return {strength: ao.bake(ring, ao.BakeOptions(**SMALL, strength=strength)) for strength in (0, 0.4, 1)}


def strengths_in(path):
    return [material.occlusionTexture.strength for material in pygltflib.GLTF2().load(path).materials]


@pytest.mark.parametrize("kind", ["glb", "gltf"])
@pytest.mark.parametrize("strength", [0, 0.4, 1])
def test_gltf_states_it_and_the_picture_stays(bakes, tmp_path, kind, strength):
    files = bakes[strength].save(tmp_path / f"a.{kind}")
    assert strengths_in(files.mesh) == [strength]
    plain = bakes[1].save(tmp_path / f"plain.{kind}")
    assert ao.compare(plain.mesh, files.mesh).difference == 0


def test_materials_of_a_file_get_it_and_their_own_is_told(gltf_square, tmp_path):
    path = gltf_square(strength=0.5)
    for strength, told in ((0.25, True), (0.5, False)):
        options = ao.BakeOptions(**SMALL, strength=strength)
        result = bake_file(path, tmp_path / "a.png", mesh_output=tmp_path / "a.gltf", options=options)
        assert strengths_in(result.files.mesh) == [strength]
        lines = [line for line in result.report.notes if "were replaced" in line]
        assert [f"their strength is {strength:g}, it was 0.5" in line for line in lines] == [told]
        assert [use.strength for use in result.report.outputs.references] == [strength]


@needs_validator
def test_the_validator_of_khronos_accepts_it(gltf_square, tmp_path):
    path = gltf_square()
    options = ao.BakeOptions(**SMALL, strength=0.3)
    result = bake_file(path, tmp_path / "a.png", mesh_output=tmp_path / "a.gltf", options=options)
    assert strengths_in(result.files.mesh) == [0.3]
    assert new_issues(path, result.files.mesh) == []


@pytest.fixture
def gltf_square(tmp_path):
    """gltf_square(**info) -> a .gltf of a square whose material has an occlusion texture, where `info` is given."""
    from gltf_kit.gltf_maker import GltfMaker

    def made(**info):
        maker = GltfMaker(tmp_path)
        points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
        material = {"occlusionTexture": {"index": maker.texture(np.full((4, 4), 128)), **info}} if info else {}
        primitive = {
            "attributes": {
                "POSITION": maker.accessor(points, min=[0, 0, 0], max=[1, 1, 0]),
                "TEXCOORD_0": maker.accessor(points[:, :2].copy()),
            },
            "indices": maker.accessor(np.array([0, 1, 2, 0, 2, 3], "<u2")),
            "material": maker.add("materials", material),
        }
        maker.node(mesh=maker.mesh(primitive))
        return maker.save("square.gltf")

    return made


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_other_formats_have_none_as_a_warning_says(bakes, tmp_path, kind):
    bakes[0.4].save(tmp_path / f"a.{kind}", report=tmp_path / "a.json")
    (line,) = [line for line in json.loads((tmp_path / "a.json").read_text())["warnings"] if "strength" in line]
    assert "has no strength of occlusion, 0.4 is not written; write a .glb" in line


@pytest.mark.parametrize("strength", [-0.1, 1.1, float("nan"), "much"])
def test_what_is_no_strength_is_refused(strength):
    with pytest.raises(ArgumentError, match="strength"):
        ao.BakeOptions(strength=strength)


def test_previews_apply_it_and_say_so(bakes, tmp_path):
    images, reports = [], []
    for strength in (0, 0.4, 1):
        drawn = ao.preview(bakes[strength].save(tmp_path / f"{strength}.glb").mesh, DRAWN)
        images.append(drawn.image.astype(int))
        reports.append(drawn.report)
    clay = ao.preview(tmp_path / "1.glb", ao.PreviewOptions(size=(64, 48), backend="ray", threads=1, shading="clay"))
    assert np.array_equal(images[0], clay.image)
    assert images[0].mean() > images[1].mean() + 1
    assert images[1].mean() > images[2].mean() + 1
    said = [[line for line in report.notes if "strength" in line] for report in reports]
    assert [len(lines) for lines in said] == [1, 1, 0]
    assert said[1][0].endswith("is drawn with its strength of 0.4, as in viewers")


def test_a_preview_with_a_strength_is_that_of_the_weakened_picture(bakes, tmp_path):
    """1 + strength * (AO - 1), section 3.9.3 of the specification of glTF 2.0."""
    result = bakes[0.4]
    drawn = ao.preview(result.save(tmp_path / "a.glb").mesh, DRAWN).image.astype(int)
    weakened = ao.preview(result.mesh, DRAWN, texture=1 + 0.4 * (result.ao - 1)).image
    assert np.abs(drawn - weakened).max() <= 2


def test_the_preview_of_a_bake_shows_what_its_gltf_does(bakes, tmp_path):
    drawn = {strength: result.preview(DRAWN).astype(int) for strength, result in bakes.items()}
    for strength, result in bakes.items():
        written = ao.preview(result.save(tmp_path / f"{strength}.glb").mesh, DRAWN).image
        assert np.abs(drawn[strength] - written).max() <= 2
    assert drawn[0].mean() > drawn[0.4].mean() + 1 > drawn[1].mean() + 2


def test_verify_measures_the_picture_and_notes_it(bakes, tmp_path):
    how = ao.VerifyOptions(points=300, rays=64, threads=1)
    weak, plain = (ao.verify(bakes[s].save(tmp_path / f"{s}.glb").mesh, options=how) for s in (0.4, 1))
    assert weak.levels == plain.levels
    notes = [[line for line in report.notes if "strength" in line] for report in (weak, plain)]
    assert [len(lines) for lines in notes] == [1, 0]
    assert notes[0][0].endswith("has a strength of 0.4, which viewers apply; the picture itself is measured")


def test_the_3d_view_has_it(bakes, tmp_path):
    mesh = mesh_to_draw(bakes[0.4].save(tmp_path / "a.glb").mesh).mesh
    assert [surface.strength for surface in view_geometry(mesh, 10_000, 64).surfaces] == [pytest.approx(0.4)]
    assert mesh.ao.min() < 0.5  # the texture itself is shown, and its histogram


def test_of_a_new_bake_in_memory_an_earlier_strength_does_not_count(gltf_square):
    path = gltf_square(strength=0.5)
    result = ao.bake(path, ao.BakeOptions(**SMALL))
    assert mesh_to_draw(result.mesh).mesh.strengths is None
    assert (mesh_to_draw(path).mesh.strengths == 0.5).all()
