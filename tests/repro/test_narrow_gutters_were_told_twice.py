"""A note told that no charts mix up to mip level 0, and a warning that they do from level 1 on: only the warning is."""

import re

import aoprecalc as ao
from aoprecalc.progress import Progress
from shapes import torus


class Lines(Progress):
    """Keeps what is told."""

    def __init__(self):
        self.lines = []

    def note(self, text):
        self.lines.append(text)

    def warn(self, text):
        self.lines.append(f"warning: {text}")


def told(size):
    lines = Lines()
    mesh = ao.Mesh(*torus(around=60, across=40))
    ao.bake(mesh, ao.BakeOptions(size=size, directions=64, unwrap="xatlas"), progress=lines)
    return [line for line in lines.lines if "gutters" in line]


def test_gutters_are_told_once():
    (narrow,) = told(64)
    assert re.match(r"warning: \d+ charts, and room for gutters of ", narrow)
    (wide,) = told(512)
    assert re.match(r"unwrap: new UVs by xatlas, \d+ charts, gutters of ", wide)
