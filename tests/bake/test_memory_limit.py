"""--memory-limit: the same texture in less memory, or one line that says how much is needed."""

import re
import subprocess
import sys

import pytest
import trimesh

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import UsageError
from aoprecalc.options import BakeOptions
from aoprecalc.visibility import plan
from aoprecalc.visibility.directions import MIN_SHADOW_SIZE
from aoprecalc.visibility.plan import FIT_CHUNK, chunks, texels_per_chunk
from shapes import quad, scene

MEGABYTE = 1 << 20


def test_a_portion_shrinks_with_the_limit_and_is_made_of_whole_parts(monkeypatch):
    monkeypatch.setattr(plan, "_resident", lambda: 300 * MEGABYTE)
    found = [
        texels_per_chunk(mb * MEGABYTE, "4096 x 4096", 1 << 24, 1 << 24, 512, 1000)
        for mb in (1420, 1440, 1500, 1600, 9000)
    ]
    assert found == sorted(found)
    assert found[0] == FIT_CHUNK
    assert found[-1] == texels_per_chunk(None, "4096 x 4096", 1 << 24, 1 << 24, 512, 1000)
    assert all(texels % FIT_CHUNK == 0 for texels in found)


def test_a_limit_that_cannot_be_kept_is_refused(monkeypatch):
    monkeypatch.setattr(plan, "_resident", lambda: 300 * MEGABYTE)
    with pytest.raises(UsageError, match=r"memory_limit is 500M; 4096 x 4096 texels of this mesh need \d+M"):
        texels_per_chunk(500 * MEGABYTE, "4096 x 4096", 1 << 24, 1 << 24, 512, 1000)


def test_the_advice_is_what_helps_and_the_limit_is_as_it_was_given(monkeypatch):
    """A smaller texture was advised at 64 x 64 texels, where all the memory is taken before the first texel."""
    monkeypatch.setattr(plan, "_resident", lambda: 300 * MEGABYTE)
    with pytest.raises(UsageError, match=r"need 396M; use a higher limit$"):
        texels_per_chunk(200 * MEGABYTE, "64 x 64", 1 << 12, 1 << 12, 512, 1000)
    with pytest.raises(UsageError, match=r"is 1G; .* need \d+M; use a higher limit or a smaller size$"):
        texels_per_chunk(1024 * MEGABYTE, "4096 x 4096", 1 << 24, 1 << 24, 512, 1000)


@pytest.mark.parametrize("backend", ["ray", "gl"])
def test_the_side_of_maps_is_looked_for_where_there_are_maps_only(backend, monkeypatch):
    found = []
    monkeypatch.setattr(plan, "_auto_shadow_size", lambda setup: found.append(setup) or MIN_SHADOW_SIZE)
    made = bake_scene(
        scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0))), BakeOptions(size=16, directions=2, backend=backend)
    )
    assert made.backend == backend
    assert len(found) == (backend == "gl")


def test_parts_cover_everything_once():
    assert [(run.start, run.stop) for run in chunks(2500, 1000)] == [(0, 1000), (1000, 2000), (2000, 2500)]


# Runs a command and prints the most memory that it held. A child begins with the peak of the process that started it,
# which for the process of the tests may be more than a bake takes; that of this one is small.
MEASURE = """
import resource, subprocess, sys
ended = subprocess.run(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(ended.returncode)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the most memory of a child is in the unit of Linux")
@pytest.mark.parametrize(
    "words",
    [("-n", "128"), ("-n", "128", "--bent-normals", "bent.png"), ("-n", "128", "--backend", "ray"), ()],
    ids=["ao", "bent-normals", "rays", "interleaved rays"],
)
def test_the_least_limit_that_is_told_is_kept_and_gives_the_same_bytes(tmp_path, words):
    square = trimesh.visual.TextureVisuals(uv=[(0, 0), (1, 0), (1, 1), (0, 1)])
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], visual=square, process=False).export(tmp_path / "square.ply")

    def bake(*limit):
        options = ["--size", "2048", "--unwrap", "keep", "-q", *words, *limit]
        command = [sys.executable, "-c", MEASURE, sys.executable, "-m", "aoprecalc", "bake", "square.ply", *options]
        ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        return ended.returncode, ended.stderr, int(ended.stdout.split()[-1]) / 1024

    def pictures():
        return [path.read_bytes() for path in sorted(tmp_path.glob("*.png"))]

    code, errors, _ = bake("--memory-limit", "1M")
    assert code == 2
    least = int(re.search(r"need (\d+)M", errors)[1])
    code, errors, most = bake("--memory-limit", f"{least}M")
    assert code == 0, errors
    assert most <= least
    limited = pictures()
    assert bake()[2] > most
    assert pictures() == limited
