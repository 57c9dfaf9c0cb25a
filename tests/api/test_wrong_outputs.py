"""Wrong outputs are refused by the argument's name, before any work and without a file."""

import pytest

import aoprecalc as ao
from shapes import ball

WRONG = [3, b"x.png", "", "a\0.png"]


@pytest.fixture(scope="module")
def baked():
    return ao.bake(ao.Mesh(*ball(1)), ao.BakeOptions(size=64, directions=64))


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("argument", ["output", "mesh_output", "report"])
def test_a_bake_is_not_saved_under_what_is_no_path(argument, wrong, baked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ao.ArgumentError, match=rf"^{argument} is .* was expected"):
        baked.save(**{"output": "out.png", argument: wrong})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", WRONG)
def test_other_outputs_are_checked_too(wrong, baked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spheres = ao.fit_spheres(baked.mesh, ao.SphereOptions(4, samples=100))
    with pytest.raises(ao.ArgumentError, match=r"^output is"):
        spheres.save(wrong)
    with pytest.raises(ao.ArgumentError, match=r"^heat_map is"):
        ao.verify(baked.mesh, heat_map=wrong)
    assert not list(tmp_path.iterdir())


def test_an_empty_cache_is_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ao.ArgumentError, match=r"^cache is empty"):
        ao.batch("m.obj", "out", cache="")
    assert not list(tmp_path.iterdir())


def test_a_size_is_named():
    with pytest.raises(TypeError):
        ao.BakeOptions(512)
