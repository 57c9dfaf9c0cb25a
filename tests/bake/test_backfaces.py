"""Occluders that count from their front only, against closed forms, by depth maps and by rays."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import SurfacePoints, area_vectors, shading_normals
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.types import Material
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.rays import RayCaster
from gltf_kit.gltf_documents import corner
from gltf_kit.gltf_maker import GltfMaker
from shapes import bowl, box, disc, quad, quad_uvs, scene, scene_of_parts

BACKENDS = pytest.mark.parametrize("backend", ["gl", "ray"])
RIM = 1 / np.sqrt(1.25)  # cosine at which the disc of radius 1 at half its radius ends, seen from below its middle


def turned(shape):
    positions, faces = shape
    return positions, faces[:, ::-1]


def under(*shapes, **material):
    """A small square that faces up at the origin, and shapes above it, of one material."""
    patch = quad((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0))
    count = sum(len(shape[1]) for shape in shapes)
    made = scene_of_parts(patch, *shapes, uvs=np.concatenate([quad_uvs((0, 0), (1, 1)), np.zeros((count, 3, 2))]))
    first, *others = made.parts
    return replace(made, parts=(first, *(replace(part, material=Material(**material)) for part in others)))


def value(made, backend, backfaces="ignore", **options):
    options = {"size": 8, "unwrap": "keep", "directions": 2000, "only": "part 0", **options}
    texture = bake_scene(made, BakeOptions(**options, backend=backend, backfaces=backfaces)).texture
    return float(texture.values[texture.valid].mean())


def reference(made, backfaces="ignore", **options):
    options = ValueOptions(only="part 0", backfaces=backfaces, **options)
    middle = SurfacePoints(np.zeros(1, int), np.array([(0.5, 0.0, 0.5)]))
    shading = shading_normals(made, "flat")
    made = assign_roles(made, options)
    integrand = Integrand.from_options(options, made)
    return float(reference_ao(made, shading, middle, VerifyOptions(), Progress(), integrand)[0])


@BACKENDS
def test_a_roof_seen_from_behind_does_not_darken_and_turned_over_it_does(backend):
    down, up = disc(0.5, 1.0), turned(disc(0.5, 1.0))
    assert value(under(up), backend) == 1
    assert reference(under(up)) == 1
    assert value(under(down), backend) == pytest.approx(RIM**2, abs=0.01)
    assert reference(under(down)) == pytest.approx(RIM**2, abs=2e-3)
    assert value(under(up), backend, "occlude") == pytest.approx(RIM**2, abs=0.01)


@BACKENDS
@pytest.mark.parametrize("material", [{"double_sided": True}, {"foliage": True}], ids=str)
def test_double_sided_materials_occlude_from_both_sides(backend, material):
    for roof in (disc(0.5, 1.0), turned(disc(0.5, 1.0))):
        assert value(under(roof, **material), backend) == pytest.approx(RIM**2, abs=0.01)


@BACKENDS
def test_two_faces_back_to_back_occlude_from_both_sides(backend):
    roof = disc(0.5, 1.0)
    made = under(roof, turned(roof))
    assert value(made, backend) == pytest.approx(RIM**2, abs=0.01)
    assert reference(made) == pytest.approx(RIM**2, abs=2e-3)


@BACKENDS
@pytest.mark.parametrize("solid", [bowl(), box()], ids=["bowl", "box"])
def test_a_solid_has_the_same_values_both_ways(backend, solid):
    made = scene(*solid)
    options = {"size": 64, "directions": 128, "backend": backend}
    both, fronts = (
        bake_scene(made, BakeOptions(**options, backfaces=backfaces)).texture for backfaces in ("occlude", "ignore")
    )
    difference = np.abs(both.values - fronts.values)[both.valid]
    if backend == "ray":
        assert difference.max() < 1e-6
    assert difference.mean() < 3e-3


def test_the_front_is_that_of_the_normals_where_the_winding_opposes_it():
    made = scene(*box())
    shading = shading_normals(made, "flat")
    inside_out = replace(made, faces=made.faces[:, ::-1].copy(), backs_occlude=False)
    fronts = NormalizedSurface.from_scene(inside_out, shading).occluders
    assert (np.einsum("ox,ox->o", area_vectors(fronts), fronts.mean(axis=1)) > 0).all()


def test_rays_go_on_through_any_number_of_backs():
    steps = np.arange(1, 40, dtype=np.float32) / 40
    triangle = np.array([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], np.float32)
    layers = triangle + steps[:, None, None] * np.array([0, 0, 1], np.float32)
    origin, up = np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32)
    front = triangle[None, ::-1] + np.array([0, 0, 1.5], np.float32)
    assert np.isnan(RayCaster(layers, 1, len(layers)).distances(origin, up))
    every = np.concatenate([layers, front])
    caster = RayCaster(every, 1, len(every))
    np.testing.assert_allclose(caster.distances(origin, up), 1.5, rtol=1e-5)
    assert caster.occluded(origin, up)
    assert not caster.occluded(origin, up, 1.4)
    np.testing.assert_allclose(RayCaster(every[::-1], 1, 30).distances(origin, up), steps[0], rtol=1e-5)


def test_the_distance_is_that_of_the_first_front():
    """A plate at .2 seen from behind, one at .5 from its front: only the second counts up to a distance of 1.25."""
    far = quad((-200, -200, 0.5), (0, 400, 0), (400, 0, 0))
    near = quad((-200, -200, 0.2), (400, 0, 0), (0, 400, 0))
    made = under(near, far)
    for falloff, expected in (("none", 0.4**2), ("linear", 1 - 0.6**2)):
        options = {"max_distance": 1.25, "falloff": falloff}
        assert value(made, "auto", **options) == pytest.approx(expected, abs=3e-3)
        assert reference(made, **options) == pytest.approx(expected, abs=3e-3)


@pytest.mark.parametrize("double_sided", [True, False])
def test_gltf_tells_which_materials_are_double_sided(double_sided, tmp_path):
    maker = GltfMaker(tmp_path)
    maker.node(mesh=maker.mesh(corner(maker, material=maker.add("materials", {"doubleSided": double_sided}))))
    assert maker.load().parts[0].material.double_sided == double_sided
