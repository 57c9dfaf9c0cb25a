"""The buffers of a two-sided bake's first side lived on through its second."""

import gc
import weakref

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.options import BakeOptions
from aoprecalc.visibility.backend import GLBackend
from shapes import scene, torus


def test_the_first_side_is_given_back_before_the_second(monkeypatch):
    made, alive = [], []
    plain = GLBackend.tester

    def tester(self, *given, **named):
        gc.collect()
        alive.append([before() is not None for before in made])
        seen = plain(self, *given, **named)
        assert not self._renderer.context.objects  # nothing waits to be released
        made.append(weakref.ref(seen))
        return seen

    monkeypatch.setattr(GLBackend, "tester", tester)
    bake_scene(scene(*torus(around=8, across=4)), BakeOptions(size=64, directions=64, two_sided=True))
    assert alive == [[], [False]]
