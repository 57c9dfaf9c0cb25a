"""An `[[override]]` that named a file alone, or matched nothing for another reason, changed nothing: exit code 0."""

import pytest

from aoprecalc.pipeline import plan_batch

TEXT = 'inputs = "**/*.obj"\noutput = "out"\nspheres = true\n[[override]]\nmatch = "{}"\nspheres.spheres = 7\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a manifest to be and a mesh below it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/spot.obj").touch()
    return tmp_path


@pytest.mark.parametrize("pattern", ["spot.obj", "meshes/spot.obj", "{folder}/meshes/spot.obj", "./meshes/*"])
def test_it_is_found_however_it_is_written(folder, pattern):
    (folder / "batch.toml").write_text(TEXT.format(pattern.format(folder=folder)))
    (asset,) = plan_batch(["batch.toml"], None, None).assets
    assert asset.spec.spheres.spheres == 7


def test_a_miss_is_an_error(folder, command):
    (folder / "batch.toml").write_text(TEXT.format("spott.obj"))
    done = command("batch", "batch.toml")
    assert done.returncode == 2
    assert "match = 'spott.obj' matches none of its meshes (nearest: 'spot.obj'" in done.stderr
