"""uvunwrap died of an index out of bounds on some meshes, with a traceback, and the bake waited for it for ever."""

import sys

import pytest

from aoprecalc.errors import AoprecalcError
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.uv.unwrap import _CHILDREN, choose_atlas
from shapes import box, scene

PANIC = """import sys, time
said = ["step: parameterizing, 3 of 9", "", "thread '<unnamed>' (7) panicked at a.rs:1:2:", "index out of bounds"]
print(*said, "stack backtrace:", "  0: nobody wants to know", sep=chr(10), file=sys.stderr, flush=True)
time.sleep(600)"""


@pytest.fixture(autouse=True)
def panic(monkeypatch):
    monkeypatch.setitem(_CHILDREN, "uvunwrap", [sys.executable, "-c", PANIC])
    monkeypatch.setattr("aoprecalc.uv.unwrap.LARGE_MESH", 10)


def choose(unwrap):
    return choose_atlas(CPURasterizer, scene(*box()), BakeOptions(size=64, unwrap=unwrap), Progress())


def test_it_is_an_error_of_one_line():
    with pytest.raises(AoprecalcError) as failure:
        choose("uvunwrap")
    assert str(failure.value) == (
        "uvunwrap could not unwrap 12 faces: a fault inside it (index out of bounds); or try unwrap xatlas"
    )


def test_auto_goes_on_with_xatlas():
    assert choose("auto").method == "xatlas"
