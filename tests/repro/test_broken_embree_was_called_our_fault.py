"""An embreex that is there but cannot be loaded ended as an ImportError, after all the work before the first ray."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("words", [["bake", "m.off", "--backend", "ray"], ["bake", "m.off", "--verify"]])
def test_it_is_no_way_to_render_and_said_before_any_work(words, tmp_path):
    (tmp_path / "m.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    package = tmp_path / "site" / "embreex"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "rtcore_scene.py").write_text("raise ImportError('libembree4.so.4: cannot open shared object file')\n")
    program = (
        f"import sys; sys.path.insert(0, {str(package.parent)!r}); sys.argv = ['aoprecalc', *{words!r}, '-v']\n"
        "from aoprecalc.cli import main; main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert "libembree4.so.4" in done.stderr
    assert "unwrap" not in done.stderr
    assert not list(tmp_path.glob("m_ao*"))
