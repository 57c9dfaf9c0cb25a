"""The estimated sampling error: it is honest, and a bake can stop by it."""

from functools import cache

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.gl.context import open_renderer
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.uv.fill import PageSpec
from aoprecalc.uv.unwrap import unwrap
from aoprecalc.visibility.backend import GLBackend
from aoprecalc.visibility.gather import gather
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from aoprecalc.visibility.source import LocalVisibility
from shapes import bowl, box, cap, clutter, join, scene, torus

SIZE = 80


def pile(seed, boxes=12):
    """Boxes turned about the vertical, on a slab and in each other's way."""
    rng = np.random.default_rng(seed)
    parts = [box((-2, -2, -0.2), (2, 2, 0))]
    for _ in range(boxes):
        half, turn = rng.uniform(0.15, 0.4, 3), rng.uniform(0, np.pi)
        cosine, sine = np.cos(turn), np.sin(turn)
        positions, faces = box(-half, half)
        place = (*rng.uniform(-1.5, 1.5, 2), half[2] + 0.25 * rng.integers(0, 4))
        parts.append((positions @ [[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]] + place, faces))
    return join(*parts)


SHAPES = {
    "torus": lambda: torus(around=24, across=12),
    "clutter-seed-0": lambda: clutter(0),
    "clutter-seed-1": lambda: clutter(1),
    "box in a bowl": lambda: join(bowl(5), box((-0.3, -0.25, -0.75), (0.25, 0.3, -0.2))),
    "pile-seed-7": lambda: pile(7),
}


@cache
def atlas_of(shape):
    """The shape and how a texture lies on it."""
    made = scene(*SHAPES[shape]())
    atlas = unwrap(made, "xatlas", PageSpec(SIZE, 2))
    return made, atlas


def gathered(shape, directions, **options):
    made, atlas = atlas_of(shape)
    given = BakeOptions(size=SIZE, directions=directions, **options)
    with open_renderer() as renderer:
        backend = GLBackend(renderer)
        site = BakeSetup(backend, BakeInputs(made, atlas, shading_normals(made), given))
        (side,) = site.sides
        found = gather(site, side, LocalVisibility(site, side, 128, len(side.texels), Progress()), len(side.texels))
        backend.check_errors()
    return found


@cache
def truth(shape):
    return gathered(shape, 16_384)


def over(found, shape):
    """How many times as large the estimate is as the error of the texels' means."""
    both = found.measured & truth(shape).measured
    return found.error / np.sqrt(((found.values - truth(shape).values)[both] ** 2).mean())


# An even set of 512 directions, four groups, errs less than the law by which its error is told: 1.6 times too high.
TOO_HIGH = {"clutter-seed-0": [512], "clutter-seed-1": [512], "pile-seed-7": [512]}


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_the_estimate_is_honest_within_a_factor_of_one_and_a_half(shape):
    ratios = {directions: over(gathered(shape, directions), shape) for directions in (256, 512, 1000, 2000)}
    beyond = [directions for directions, ratio in ratios.items() if not 1 / 1.5 < ratio < 1.5]
    assert beyond == TOO_HIGH.get(shape, [])
    assert max(ratios.values()) < 1.75


@pytest.mark.slow
def test_a_target_stops_the_gather_early_with_what_is_known_by_then():
    found = gathered("torus", 2000, target_error=0.006)
    assert found.directions < 1000
    assert found.directions % 128 == 0
    assert found.error <= 0.006
    assert 0.003 < found.error / over(found, "torus") < 0.009
    missed = gathered("torus", 512, target_error=1e-4)
    assert missed.directions == 512
    assert missed.error > 1e-4


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_bake_says_how_far_it_came(backend):
    made = scene(*SHAPES["torus"]())

    def bake(directions, target):
        options = BakeOptions(size=SIZE, directions=directions, target_error=target, backend=backend)
        baked = bake_scene(made, options)
        return baked, [line for line in baked.warnings if "sampling error" in line]

    baked, said = bake(4000, 0.01)
    assert baked.directions < 4000
    assert baked.sampling_error <= 0.01
    assert said == []
    baked, said = bake(300, 1e-4)
    assert baked.directions == 300
    assert f"{baked.sampling_error:.4f} after 300 directions, more than the target of 0.0001" in said[0]
    baked, said = bake(128, 0.5)
    assert baked.sampling_error is None
    assert "128 directions or fewer" in said[0]
    assert bake(300, 0.0)[0].directions == 300


@pytest.mark.slow
def test_two_sides_report_the_greater_error_and_the_later_stop():
    """Half a sphere: its outside is open, and tells at once that it is; its inside takes longer."""
    made = scene(*cap(6))
    outside, inside, both = (
        bake_scene(mesh, BakeOptions(size=SIZE, directions=2000, target_error=0.004, two_sided=two_sided))
        for mesh, two_sided in ((made, False), (scene(made.positions, made.faces[:, ::-1]), False), (made, True))
    )
    assert outside.sampling_error == 0
    assert outside.directions < inside.directions == both.directions
    assert both.sampling_error == pytest.approx(inside.sampling_error, rel=0.2)
