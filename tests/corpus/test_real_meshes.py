"""Whole bakes of real meshes: beside a map that others ray-traced, and without specks at chart borders."""

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.io import load_scene, read_image
from aoprecalc.io.baked_options import occlusion_values
from aoprecalc.io.formats.gltf.occlusion_textures import gltf_occlusion
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout
from aoprecalc.texture_lookup import bilinear
from aoprecalc.uv.checks import needs_uvs
from shapes import MESHES

pytestmark = [pytest.mark.corpus, pytest.mark.slow]


def test_the_ogre_agrees_with_its_authored_map():
    texture = bake_scene(load_scene(MESHES / "jerry_ogre/bs_rest.obj"), BakeOptions(size=512, directions=256)).texture
    authored = read_image(MESHES / "jerry_ogre/ao_rest.png").reshape(512, 2, 512, 2).mean(axis=(1, 3))
    assert np.corrcoef(texture.values.ravel(), authored.ravel())[0, 1] > 0.99


@pytest.mark.parametrize("name", ["bigguy.obj", "spot.obj", "DamagedHelmet/DamagedHelmet.gltf"])
def test_borders_have_no_specks(name):
    """A texel at a chart's border is seldom brighter or darker than all of its covered neighbours by much."""
    texture = bake_scene(load_scene(MESHES / name), BakeOptions(size=512, directions=256)).texture
    inner = texture.valid[1:-1, 1:-1]
    shifts = [(row, column) for row in range(3) for column in range(3) if (row, column) != (1, 1)]
    around = np.stack([texture.values[row : row + 510, column : column + 510] for row, column in shifts])
    covered = np.stack([texture.valid[row : row + 510, column : column + 510] for row, column in shifts])
    border = inner & ~covered.all(axis=0) & (covered.sum(axis=0) >= 3)
    highest = np.where(covered, around, -1).max(axis=0)
    lowest = np.where(covered, around, 2).min(axis=0)
    values = texture.values[1:-1, 1:-1]
    speck = border & ((values > highest + 0.1) | (values < lowest - 0.1))
    assert speck.sum() < 0.01 * border.sum()


@pytest.mark.parametrize("name", ["bigguy.obj", "ToyCar/ToyCar.gltf", "DamagedHelmet/DamagedHelmet.gltf"])
def test_new_uvs_use_most_of_the_texture_and_every_face_has_its_own_texels(name):
    options = BakeOptions(size=1024, directions=16, unwrap="xatlas", backend="ray")
    baked = bake_scene(load_scene(MESHES / name), options)
    assert baked.texture.valid.mean() >= 0.6
    assert (baked.atlas.mapped == needs_uvs(baked.scene)).all()
    assert CPURasterizer(build_layout(baked.scene, baked.atlas, 1024, 1024)).overlap() == 0


@pytest.fixture(scope="module")
def toy_car():
    """The scene and its bake."""
    scene = load_scene(MESHES / "ToyCar/ToyCar.gltf")
    return scene, bake_scene(scene, BakeOptions(size=512, directions=256))


@pytest.mark.parametrize(("part", "least"), [("ToyCar", 0.9), ("Fabric", 0.93)])
def test_the_toy_car_agrees_with_its_authored_maps(toy_car, part, least):
    scene, baked = toy_car
    chosen = next(entry for entry in scene.parts if entry.name == part)
    authored = gltf_occlusion(scene.document, chosen)
    mapped = np.zeros(len(scene.faces), bool)
    mapped[chosen.faces] = True
    points = sample_surface(scene, mapped & baked.atlas.mapped, 10_000, 0)
    uvs = np.zeros((len(scene.faces), 3, 2))
    uvs[chosen.faces] = authored.uvs
    wanted = bilinear(occlusion_values(authored.image), points.interpolate(uvs), repeats=True)
    found = bilinear(baked.texture.values, points.interpolate(baked.atlas.uvs), repeats=False)
    assert np.corrcoef(wanted, found)[0, 1] > least
