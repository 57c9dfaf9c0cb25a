"""Once in some thousand unwraps xatlas hung in the destructor of an atlas, which waits for threads of its own."""

import sys

from aoprecalc.uv.fill import PageSpec
from aoprecalc.uv.unwrap import _CHILDREN, unwrap
from shapes import box, scene

STUCK = """import time
import xatlas

class Stuck(xatlas.Atlas):
    def __del__(self, wait=time.sleep):  # found even when modules are gone
        wait(600)

xatlas.Atlas = Stuck
from aoprecalc.uv.unwrap import main
main("xatlas")"""


def test_no_destructor_is_waited_for(monkeypatch):
    made = scene(*box())
    expected = unwrap(made, "xatlas", PageSpec(64, 2)).uvs
    monkeypatch.setitem(_CHILDREN, "xatlas", [sys.executable, "-c", STUCK])
    assert (unwrap(made, "xatlas", PageSpec(64, 2), timeout=60).uvs == expected).all()
