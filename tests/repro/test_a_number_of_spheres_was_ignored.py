"""`-n` beside `--tolerance` or `--levels`, which say how many instead, was dropped without a word."""

import subprocess
import sys

import pytest
import trimesh


@pytest.mark.parametrize("instead", [("--tolerance", "0.05"), ("--levels", "2,4")], ids="_".join)
@pytest.mark.slow
def test_two_numbers_are_refused_and_one_is_not(tmp_path, instead):
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.ply")
    codes = []
    for number in (("-n", "10"), ()):
        words = ["spheres", "ball.ply", "-s", "500", *instead, *number]
        done = subprocess.run([sys.executable, "-m", "aoprecalc", *words], cwd=tmp_path, capture_output=True, text=True)
        codes.append(done.returncode)
    assert codes == [2, 0]
