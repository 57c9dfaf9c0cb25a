"""Maps and rays give the same picture, and each stands in for the other or says what is missing."""

import sys

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import RendererError
from aoprecalc.gl import context
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.texture_lookup import bilinear
from shapes import ball, bowl, box, clutter, dented, join, scene, torus


def no_opengl():
    raise RendererError("no OpenGL 4.3 context could be made")


SHAPES = {
    "torus": torus,
    "dented-seed-3": lambda: dented(3),
    "box in a bowl": lambda: join(bowl(), box((-0.3, -0.25, -0.75), (0.25, 0.3, -0.2))),
}


def bake(made, backend, shadow_size=None):
    baked = bake_scene(made, BakeOptions(size=128, directions=512, backend=backend, shadow_size=shadow_size))
    assert baked.backend == backend
    assert (baked.shadow_size is None) == (backend == "ray")
    return baked


def differences(maps, rays):
    """The difference of two pictures at points uniform on the surface."""
    assert (maps.texture.valid == rays.texture.valid).all()
    points = sample_surface(maps.scene, maps.atlas.mapped, 20_000, seed=0)
    uvs = points.interpolate(maps.atlas.uvs)
    return bilinear((maps.texture.values - rays.texture.values), uvs, repeats=False)


@pytest.mark.gl
@pytest.mark.parametrize("shape", ["torus", pytest.param("dented-seed-3", marks=pytest.mark.slow), "box in a bowl"])
def test_maps_and_rays_give_the_same_picture(shape):
    made = scene(*SHAPES[shape]())
    off = differences(bake(made, "gl"), bake(made, "ray"))
    assert np.sqrt((off**2).mean()) < 0.002
    assert abs(off.mean()) < 2e-4
    assert np.quantile(np.abs(off), 0.99) < 0.01


@pytest.mark.slow
def test_finer_maps_come_closer_to_rays_where_parts_run_into_each_other():
    """There faces meet on no edge of either, and maps are right to a texel of theirs."""
    made = scene(*clutter(0))
    rays = bake(made, "ray")
    coarse, fine = (np.sqrt((differences(bake(made, "gl", size), rays) ** 2).mean()) for size in (512, 1024))
    assert coarse < 0.008
    assert fine < 0.7 * coarse


class Heard(Progress):
    def __init__(self):
        self.notes, self.done = [], 0

    def note(self, text):
        self.notes.append(text)

    def advance(self, count=1):
        self.done += count


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_every_direction_is_counted(backend):
    heard = Heard()
    bake_scene(scene(*ball(1)), BakeOptions(size=32, directions=300, backend=backend, two_sided=True), heard)
    assert heard.done == 600


@pytest.mark.gl
def test_auto_falls_back_to_rays_and_says_so(monkeypatch):
    monkeypatch.setattr(context, "_create", no_opengl)
    made, heard = scene(*ball(1)), Heard()
    baked = bake_scene(made, BakeOptions(size=32, directions=64), heard)
    assert (baked.backend, baked.renderer) == ("ray", "Embree")
    assert "no OpenGL 4.3: rays are traced, which takes longer; `aoprecalc doctor` says how to get the faster way" in (
        heard.notes
    )
    with pytest.raises(RendererError, match="no OpenGL"):
        bake_scene(made, BakeOptions(size=32, directions=64, backend="gl"))


@pytest.mark.gl
def test_without_rays_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    made = scene(*ball(1))
    install = "pip install embreex"
    with pytest.raises(RendererError, match=install):
        bake_scene(made, BakeOptions(size=32, directions=64, backend="ray"))
    assert bake_scene(made, BakeOptions(size=32, directions=64)).backend == "gl"
    monkeypatch.setattr(context, "_create", no_opengl)
    with pytest.raises(RendererError, match=f"no OpenGL.*{install}"):
        bake_scene(made, BakeOptions(size=32, directions=64))
