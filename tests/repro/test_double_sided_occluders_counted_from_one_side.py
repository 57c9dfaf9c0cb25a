"""With `--backfaces ignore`, triangles of `--occluder` files forgot that their material is double-sided: light passed
through a roof whose faces looked up."""

import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_maker import GltfMaker
from shapes import disc, quad, quad_uvs, scene

OPEN = 0.8  # of the light below the middle of a disc whose radius is half its height: 1 / (1 + 1/4)


def roof_file(folder, *, turned, **material):
    """A disc that faces down, or up, with a material of a glTF."""
    positions, faces = disc(0.5, 1.0)
    faces = faces[:, ::-1] if turned else faces
    maker = GltfMaker(folder)
    attributes = {"POSITION": maker.vertices(positions.astype("<f4"), bounds=True)}
    material = maker.add("materials", material)
    maker.node(
        mesh=maker.mesh({"attributes": attributes, "indices": maker.indices(faces.astype("<u2")), "material": material})
    )
    return maker.save()


@pytest.mark.parametrize("backend", ["gl", "ray"])
@pytest.mark.parametrize(
    ("turned", "double_sided", "open_share"), [(False, False, OPEN), (True, False, 1), (True, True, OPEN)]
)
def test_a_roof_of_a_file_counts_from_the_sides_of_its_material(backend, turned, double_sided, open_share, tmp_path):
    patch = scene(*quad((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0)), quad_uvs((0, 0), (1, 1)))
    options = {"size": 8, "unwrap": "keep", "directions": 2000, "backend": backend, "backfaces": "ignore"}
    roof = roof_file(tmp_path, turned=turned, doubleSided=double_sided)
    baked = bake_scene(patch, BakeOptions(**options, occluder=roof))
    values = baked.texture.values[baked.texture.valid]
    assert values.mean() == pytest.approx(open_share, abs=0.01)
    assert any("occludes with 128 triangles" in line for line in baked.scene.notes)
