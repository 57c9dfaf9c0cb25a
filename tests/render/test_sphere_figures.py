"""Figure 1.5: dots stand on the surface that is seen, and all its pictures have one camera."""

import numpy as np
import pytest

from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import PreviewOptions, SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.render.figures import FittedSpheres, sphere_figures
from aoprecalc.render.preview import open_stage
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.spheres.fit import surface_samples
from aoprecalc.types import SphereSet, TexturedMesh
from shapes import ball, box, join, scene

BACKENDS = ["gl", "ray"]
LOOK = {"size": (160, 120), "ground": True, "shading": "clay"}


def drawable(shape):
    """A mesh without a texture, as pictures show it."""
    made = scene(*shape)
    normals = shading_normals(made).astype(np.float64)
    return TexturedMesh(made, normals, None, None, np.zeros(len(made.faces), bool))


def fitted(centers, radii, method="lloyd"):
    centers, radii = np.array(centers, float), np.array(radii, float)
    return FittedSpheres(SphereSet(centers, radii, 1, True, method, "mean", 100, 0), 0.5, 0.01)


def drawn(mesh, samples, sets, backend, **more):
    options = PreviewOptions(**{**LOOK, "backend": backend, **more})
    figures = sphere_figures(mesh, np.asarray(samples, float).reshape(-1, 3), sets, options, Progress())
    return {figure.name: figure.picture.astype(int) for figure in figures}


@pytest.mark.parametrize("backend", BACKENDS)
def test_dots_stand_where_the_surface_is_seen(backend):
    """Those on the front of a ball are drawn at their places, those behind it and inside it are not."""
    mesh = drawable(ball(4))
    with open_stage(mesh, [], 160, PreviewOptions(**LOOK, backend=backend), Progress()) as stage:
        camera = stage.cameras[0]
        towards = camera.eye / np.linalg.norm(camera.eye)
        column, row, _ = camera.project(stage.frame.points(towards))
    pictures = drawn(mesh, [towards, -towards, 0.5 * towards], [], backend)
    changed = np.argwhere((pictures["1_5_samples"] != pictures["1_5_mesh"]).any(axis=2))
    assert len(changed)
    assert np.abs(changed + 0.5 - (row, column)).max() < 4  # pixels
    hidden = drawn(mesh, [-towards, 0.5 * towards], [], backend)
    np.testing.assert_array_equal(hidden["1_5_samples"], hidden["1_5_mesh"])


@pytest.mark.parametrize("backend", BACKENDS)
def test_dots_cover_their_share_and_nothing_but_the_mesh(backend):
    mesh = drawable(join(ball(3), box((0.5, -1, -1), (1.5, 0, 1))))
    pictures = drawn(mesh, surface_samples(mesh.scene, 20_000, 0), [], backend)
    with open_stage(mesh, [], 160, PreviewOptions(**LOOK, backend=backend), Progress()) as stage:
        seen = np.isfinite(stage.depths())
    darker = (pictures["1_5_mesh"] - pictures["1_5_samples"]).sum(axis=2) / np.maximum(
        pictures["1_5_mesh"].sum(axis=2), 1
    )
    assert (darker[~np.pad(seen, 3)[3:-3, 3:-3]] > 0).mean() < 0.01  # rims of dots at the outline
    assert 0.08 < darker[seen].mean() < 0.3
    assert (darker[seen] > 0).mean() > 0.5


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sphere_in_place_of_a_ball_gives_the_same_outline_and_shadow(backend):
    mesh = drawable(ball(4))
    pictures = drawn(mesh, np.zeros((0, 3)), [fitted([[0, 0, 0]], [1])], backend, size=(240, 180))
    ground = drawn(mesh, np.zeros((0, 3)), [fitted([[0, 0, 0]], [0])], backend, size=(240, 180))["1_5_lloyd"]
    of_mesh, of_sphere = ((pictures[name] != ground).any(axis=2) for name in ("1_5_mesh", "1_5_lloyd"))
    assert (of_mesh != of_sphere).mean() < 0.01
    blue = pictures["1_5_lloyd"][..., 2] - pictures["1_5_lloyd"][..., 0] > 25
    outside = of_mesh & of_sphere & ~blue
    assert np.abs(pictures["1_5_mesh"] - pictures["1_5_lloyd"])[outside].mean() < 3  # the shadows


@pytest.mark.parametrize("radius", [30.9, 60.0])
def test_spheres_far_larger_than_the_mesh_do_not_move_the_camera(radius):
    """One that ends just above the mesh, and one that holds the camera: the mesh's picture has the same bytes."""
    mesh, sphere = drawable(ball(2)), fitted([[0, 0, 0]], [1])
    alone = drawn(mesh, [], [sphere], "ray", size=(80, 60))
    huge = fitted([[0, 30, 0], [0, 0, 0]], [radius, 1], "algebraic")
    beside = drawn(mesh, [], [sphere, huge], "ray", size=(80, 60))
    for name, picture in alone.items():
        np.testing.assert_array_equal(picture, beside[name])
    assert (beside["1_5_algebraic"] != alone["1_5_lloyd"]).any()


def test_the_caption_says_how_many_spheres_may_leave_the_picture():
    mesh = drawable(ball(1))
    sets = [
        fitted([[0, 0, 0], [0, 0.2, 0]], [1, 1]),
        fitted([[0, 0, 0], [0, 5, 0], [0, 0, 0.6]], [1, 1, 1], "algebraic"),
    ]
    figures = sphere_figures(mesh, np.zeros((0, 3)), sets, PreviewOptions(**{**LOOK, "size": (80, 60)}), Progress())
    inside, leaving = (figure.caption for figure in figures[2:])
    assert "leave" not in inside
    assert "2 spheres beyond 1.25 radii of the mesh may leave the picture." in leaving


def test_the_samples_are_those_that_spheres_are_fitted_to():
    """A sphere for each sample lies on that sample."""
    made = scene(*ball(2))
    options = SphereOptions(spheres=30, samples=30, seed=4)
    centers = fit_sphere_set(made, options, Progress())[0].centers
    samples = surface_samples(made, 30, 4)
    apart = np.linalg.norm(centers[:, None] - samples, axis=2).min(axis=1)
    assert apart.max() < 1e-12


def test_figures_are_deterministic(tmp_path):
    mesh = drawable(ball(3))
    samples = surface_samples(mesh.scene, 500, 1)
    one, other = (drawn(mesh, samples, [fitted([[0, 0, 0]], [0.8])], "ray") for _ in range(2))
    for name, picture in one.items():
        np.testing.assert_array_equal(picture, other[name])
