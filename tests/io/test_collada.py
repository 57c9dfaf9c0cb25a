"""COLLADA: polygons, UV sets and materials of every instance, in the world."""

import io
import zipfile

import numpy as np
import pytest
from PIL import Image

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene, output_mesh_extension
from aoprecalc.io.formats import collada
from aoprecalc.io.meshes import base_colors
from aoprecalc.mesh.surface import face_normals
from collada_text import UVS, colored, document, textured
from gltf_kit.gltf_validator import issues, needs_validator

pytest.importorskip("collada")

HALF = np.full((4, 4, 4), 255, np.uint8)
HALF[:, 2:, 3] = 0  # of it is a hole
BLACK_HOLES = HALF[:, :, 3:].repeat(3, axis=2)


def png(array):
    data = io.BytesIO()
    Image.fromarray(array).save(data, "PNG")
    return data.getvalue()


@pytest.mark.parametrize("matrix", ["", "-1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1"], ids=["as it is", "mirrored"])
def test_polygons_normals_and_uvs_are_placed_in_the_world(save, matrix):
    scene = load_scene(save("a.dae", document(matrix=matrix)))
    assert [(part.name, part.names) for part in scene.parts] == [("sheet", {"shape", "paint"})]
    assert len(scene.faces) == 3
    normals, _ = face_normals(scene.corners)
    assert np.abs(normals - (0, 0, 1)).max() == 0
    assert np.abs(scene.normals - (0, 0, 1)).max() == 0
    areas = np.linalg.norm(np.cross(*np.diff(scene.corners, axis=1).transpose(1, 0, 2)), axis=1) / 2
    assert areas.sum() == 10
    x = 5 - scene.corners[:, :, 0] if matrix else scene.corners[:, :, 0]
    assert scene.uvs == pytest.approx(np.stack([x, scene.corners[:, :, 1]], axis=2) / 4)


def test_colours_are_srgb(save):
    diffuse = f"<emission>{colored(1, 0, 0)}</emission><diffuse>{colored(0.5, 1, 0)}</diffuse>"
    scene = load_scene(save("a.dae", document(diffuse)))
    paint = scene.document.materials["paint"]
    assert (paint.color, paint.emission, paint.alpha_mode) == ((0.5, 1, 0), (1, 0, 0), "OPAQUE")
    assert base_colors(scene)[0][0].factor == pytest.approx((0.21404, 1, 0), abs=1e-4)
    assert scene.warnings == ()


@pytest.mark.parametrize(
    ("transparent", "transparency", "opacity"),
    [
        ('<transparent opaque="A_ONE">' + colored(0, 0, 0, 0.5), 0.5, 0.25),
        ("<transparent>" + colored(1, 1, 1, 0.25), None, 0.25),
        ('<transparent opaque="RGB_ZERO">' + colored(1, 1, 1), 0.75, 0.25),
        ('<transparent opaque="RGB_ZERO">' + colored(0, 0, 0), None, 1),
        ('<transparent opaque="RGB_ZERO">' + colored(0.5, 0.5, 0.5), None, 1 - 0.21404),
        ('<transparent opaque="RGB_ONE">' + colored(1, 1, 1), 0.25, 0.25),
        ('<transparent opaque="A_ZERO">' + colored(1, 1, 1, 0.75), None, 0.25),
        (None, 0.5, 0.5),
        (None, None, 1),
    ],
)
def test_opacity(save, transparent, transparency, opacity):
    elements = f"{transparent}</transparent>" if transparent else ""
    if transparency is not None:
        elements += f"<transparency><float>{transparency}</float></transparency>"
    scene = load_scene(save("a.dae", document(elements)))
    assert scene.document.materials["paint"].opacity == pytest.approx(opacity, abs=1e-4)
    assert scene.parts[0].material.transparent == (opacity < 1)


def test_what_is_quite_transparent_is_taken_as_opaque(save):
    scene = load_scene(save("a.dae", document("<transparency><float>0</float></transparency>")))
    assert not scene.parts[0].material.transparent
    assert scene.warnings == ("the material 'paint' has an opacity of 0, which would hide it: it is taken as opaque",)


@pytest.mark.parametrize(
    ("mode", "pixels"), [("A_ONE", HALF), ("RGB_ONE", BLACK_HOLES), ("RGB_ZERO", 255 - BLACK_HOLES)]
)
def test_a_picture_of_the_transparency_is_a_mask(save, bake, mode, pixels):
    save("holes.png", png(pixels))
    save("color.png", png(HALF[:, :, :3]))
    effect = f'<diffuse>{textured("color")}</diffuse><transparent opaque="{mode}">{textured("holes")}</transparent>'
    both = "<extra><technique profile='GOOGLEEARTH'><double_sided>1</double_sided></technique></extra>"
    before = load_scene(save("a.dae", document(effect, both)))
    assert before.warnings == ()
    path, *_ = bake(before, "a_ao.glb")
    after = load_scene(path)
    for scene in (before, after):
        material = scene.parts[0].material
        assert np.array_equal(material.alpha_mask.alpha, HALF[:, :, 3] / 255)
        assert np.allclose(material.alpha_mask.uvs, before.uvs)
        assert material.foliage
    (color,) = base_colors(after)[0]
    assert np.array_equal(color.texture, HALF[:, :, :3])


def test_the_picture_has_the_uvs_that_its_material_binds(save):
    save("color.png", png(HALF[:, :, :3]))
    second = [(u / 2, v / 2) for u, v in UVS]
    effect = f"<diffuse>{textured('color')}</diffuse>"
    scene = load_scene(save("a.dae", document(effect, sets=(UVS, second))))
    assert [uvs.max() for uvs in scene.uv_sets] == [0.5, 1]


@pytest.mark.parametrize("place", ["color.png", "textures/COLOR.png", "../textures/color.png"])
def test_pictures_are_found_where_packs_have_them(save, place):
    text = document(f"<diffuse>{textured('color')}</diffuse>").replace(">color.png<", ">file:///C:/a%20b/color.png<")
    path = save("models/a.dae", text)
    save(f"models/{place}", png(HALF[:, :, :3]))
    (color,), warnings = base_colors(load_scene(path))
    assert (color.texture is not None, warnings) == (True, ())


def test_pictures_in_an_archive_reach_the_glb(save, bake):
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as files:
        files.writestr("scene/a.dae", document(f"<diffuse>{textured('color')}</diffuse>"))
        files.writestr("scene/color.png", png(HALF[:, :, :3]))
    path, *_ = bake(load_scene(save("a.zae", archive.getvalue())), "a_ao.glb")
    assert base_colors(load_scene(path))[0][0].texture is not None


def test_what_is_lost_is_named(save):
    effect = f"<diffuse>{textured('color')}</diffuse><specular>{textured('holes')}</specular>"
    more = "<library_cameras><camera id='a'/></library_cameras><library_lights><light id='a'/></library_lights>"
    scene = load_scene(save("a.dae", document(effect, libraries=more)))
    assert "COLLADA is read without cameras, lights, which it has; export it as glTF" in scene.warnings[-1]
    assert scene.document.materials["paint"].left_out == ("the specular picture of paint",)
    _, (warning,) = base_colors(scene)
    assert "color.png" in warning


def test_units_and_axes_are_told(save):
    scene = load_scene(save("a.dae", document(asset='<unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis>')))
    assert (scene.up, scene.unit) == ("z", 0.0254)
    assert ["its unit is 0.0254 metres" in scene.notes[0], "its axis Z points up" in scene.notes[1]] == [True, True]
    plain = load_scene(save("b.dae", document()))
    assert (plain.up, plain.unit, plain.notes) == ("y", 1, ())


def test_the_bake_becomes_a_glb(save, bake):
    scene = load_scene(save("a.dae", document()))
    assert output_mesh_extension(scene) == (".glb", "COLLADA is not written, so the mesh becomes a GLB")
    path, *_ = bake(scene, "a_ao.glb")
    assert np.array_equal(load_scene(path).corners, scene.corners)


@needs_validator
def test_the_validator_finds_nothing(save, bake):
    save("holes.png", png(HALF))
    save("color.png", png(HALF[:, :, :3]))
    effect = f"<diffuse>{textured('color')}</diffuse><transparent>{textured('holes')}</transparent>"
    path, *_ = bake(load_scene(save("a.dae", document(effect))), "a_ao.glb")
    assert [issue["message"] for issue in issues(path)[0]] == []


def test_a_missing_package_is_named(save, monkeypatch):
    monkeypatch.setattr(collada, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"the package pycollada; `pip install 'aoprecalc\[formats\]'`"):
        load_scene(save("a.dae", document()))


@pytest.mark.parametrize("part", [0.05, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_a_truncated_file_is_an_input_error(save, part):
    text = document()
    with pytest.raises(InputError):
        load_scene(save("a.dae", text[: int(len(text) * part)]))


def test_nodes_within_themselves_are_an_input_error(save):
    nodes = '<node id="a"><instance_node url="#b"/></node><node id="b"><instance_node url="#a"/></node>'
    with pytest.raises(InputError):
        load_scene(save("a.dae", document(nodes=nodes)))
