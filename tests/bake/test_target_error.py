"""The estimated sampling error: it is honest, and a bake can stop by it."""

import numpy as np
import pytest

from aoprecalc.atlas.unwrap import unwrap
from aoprecalc.occlusion.axes import axes
from aoprecalc.occlusion.gathering import gather
from aoprecalc.occlusion.map_observer import MapObserver
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.recipes import bake_scene
from aoprecalc.surface.normals import shading_normals
from aoprecalc.surface.unit import UnitSurface
from aoprecalc.texspace.layout import lay_out
from aoprecalc.texspace.scanline import ScanlineRaster
from shapes import bowl, box, clutter, join, scene, torus

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


@pytest.mark.parametrize("shape", SHAPES)
def test_the_estimate_is_honest(renderer, shape):
    """Within a factor of 1.5 of how far the texels' means are from those of very many directions."""
    made = scene(*SHAPES[shape]())
    atlas = unwrap(made, "xatlas", SIZE, 2)
    sampler = ScanlineRaster(lay_out(made, atlas, SIZE, SIZE))
    texels = sampler.coverage()
    surface = UnitSurface.of(made, shading_normals(made))
    observer = MapObserver(renderer, surface, len(texels), 128)

    def gathered(directions):
        given = observer, sampler, made, atlas, texels, axes(directions)
        return gather(*given, BakeOptions(SIZE, SIZE), Progress())

    truth = gathered(16_384)
    # Four whole groups, 512 directions, complete each other best: there the estimate is highest above the truth.
    for directions, factor in ((256, 1.5), (512, 1.75), (1000, 1.5), (2000, 1.5)):
        found = gathered(directions)
        both = found.measured & truth.measured
        error = np.sqrt(((found.values - truth.values)[both] ** 2).mean())
        assert 1 / 1.5 < found.error / error < factor, directions


def test_it_stops_early_and_says_how_many_directions_it_took():
    made = scene(*torus())
    options = {"width": SIZE, "height": SIZE, "directions": 2000}
    whole = bake_scene(made, BakeOptions(**options))
    early = bake_scene(made, BakeOptions(**options, target_error=3 * whole.error))
    assert early.error <= 3 * whole.error
    assert early.directions <= whole.directions / 2
    assert early.directions % 256 == 0  # two groups of axes at a time
    assert not any("sampling error" in line for line in early.warnings)


def test_a_target_out_of_reach_is_said():
    baked = bake_scene(scene(*torus()), BakeOptions(width=64, height=64, directions=256, target_error=1e-6))
    assert baked.directions == 256
    assert any("1e-06 asked for" in line for line in baked.warnings)


def test_one_group_of_axes_has_no_estimate():
    baked = bake_scene(scene(*torus()), BakeOptions(width=64, height=64, directions=128, target_error=0.5))
    assert baked.error is None
    assert any("more than 128 directions" in line for line in baked.warnings)
