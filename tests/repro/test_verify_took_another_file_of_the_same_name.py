"""A texture knows the files of its bake by name, so `verify` took whatever file of that name lay beside the mesh."""

import re

import pytest
import trimesh

import aoprecalc as ao
from aoprecalc.errors import InputError
from aoprecalc.io.baked_options import bake_text, read_options
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from bake.test_projection import bumpy, plane
from shapes import quad

FEW = {"points": 500, "rays": 256}
WALL = quad((-1, 1, 0), (0, -2, 0), (0, 0, 2))


def saved(folder, name, shape):
    """Write a mesh file in a folder, which is made."""
    folder.mkdir(exist_ok=True)
    trimesh.Trimesh(*shape, process=False).export(folder / name)
    return folder / name


@pytest.fixture
def bake(tmp_path):
    """Bakes simple/rock.obj, and writes the mesh of the result beside it."""
    simple = saved(tmp_path / "simple", "rock.obj", plane())

    def baked(**options):
        options = BakeOptions(size=64, directions=256, backend="ray", **options)
        return ao.bake(simple, options).save(f"{tmp_path}/simple/").mesh

    return baked


def test_the_simple_mesh_itself_is_not_taken_for_the_detailed_one(bake, tmp_path):
    detailed = saved(tmp_path / "detailed", "rock.obj", bumpy(0.1, 32, 25))
    mesh = bake(high=detailed)
    told = (
        f"rock_ao.png: was baked with high rock.obj, but another is in the folder of {mesh}; give the option with its"
    )
    with pytest.raises(InputError, match=re.escape(told)):
        ao.verify(mesh, options=VerifyOptions(**FEW))
    assert ao.verify(mesh, options=VerifyOptions(high=detailed, **FEW)).error < 0.03


def test_one_file_is_not_taken_for_those_of_two_options(bake, tmp_path):
    """The file of the one option is beside the mesh, and that of the other is not."""
    detailed = saved(tmp_path / "detailed", "part.obj", bumpy(0.1, 32, 25))
    wall = saved(tmp_path / "around", "part.obj", WALL)
    mesh = bake(high=detailed, occluder=wall)
    saved(tmp_path / "simple", "part.obj", WALL)
    with pytest.raises(InputError, match=r"baked with high part.obj, but another is in the folder"):
        ao.verify(mesh, options=VerifyOptions(**FEW))
    assert ao.verify(mesh, options=VerifyOptions(high=detailed, **FEW)).error < 0.03  # the wall is found


def test_lost_and_other_files_are_told_in_one_line(bake, tmp_path):
    walls = [saved(tmp_path / "around", name, WALL) for name in ("a.obj", "b.obj")]
    mesh = bake(high=saved(tmp_path / "detailed", "rock.obj", bumpy(0.1, 32, 25)), occluder=walls)
    told = (
        f"was baked with occluder a.obj, occluder b.obj, which are not in the folder of {mesh}, and with high "
        "rock.obj, but another is there; give the options with the paths of all 3 files"
    )
    with pytest.raises(InputError, match=re.escape(told)):
        ao.verify(mesh, options=VerifyOptions(**FEW))


def test_the_same_file_elsewhere_gives_the_same_text_and_a_changed_one_another(tmp_path):
    texts = []
    for folder, shape in (("a", WALL), ("b", WALL), ("c", plane())):
        texts.append(bake_text(ValueOptions(occluder=saved(tmp_path / folder, "wall.obj", shape)), 12))
    assert texts[0] == texts[1] != texts[2]
    assert read_options(texts[0]) == ValueOptions(occluder="wall.obj")
    unreadable = bake_text(ValueOptions(occluder=tmp_path / "lost.obj"), 12)
    assert read_options(unreadable) == ValueOptions(occluder="lost.obj")
