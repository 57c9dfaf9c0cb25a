"""Names that are nearly right, or right in another program, got a list of all names, or nothing."""

import pytest

from aoprecalc.errors import SYNONYMS, nearest
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.options.fields import option_fields
from gltf_kit.gltf_documents import APART, corner
from gltf_kit.gltf_maker import GltfMaker
from pipeline.helpers import write_ring


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["bake", "a.obj", "--spp", "64"], "--directions"),
        (["bake", "a.obj", "--rays=64"], "--directions"),
        (["bake", "a.obj", "--resolution", "64"], "--size"),
        (["bake", "a.obj", "--margin", "4"], "--padding"),
        (["bake", "a.obj", "--dilation", "4"], "--padding"),
        (["spheres", "a.obj", "--count", "8"], "--spheres"),
        (["bake", "a.obj", "--Size", "64"], "--size"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_options_of_other_programs(command, words, hint):
    done = command(*words)
    assert done.returncode == 2
    assert f"(did you mean '{hint}'?)" in done.stderr


def test_synonyms_stand_for_options_that_there_are():
    known = {field.name for kind in (BakeOptions, SphereOptions) for field in option_fields(kind)}
    assert known >= set(SYNONYMS.values())
    assert nearest("samples", ["samples", "directions"]) == "directions"  # asked only about names that are wrong


def test_the_nearest_mesh_beside(tmp_path, command):
    mesh = write_ring(tmp_path / "spot.obj")
    done = command("bake", tmp_path / "spto.obj")
    assert done.returncode == 4
    assert f"there is no such file (did you mean {mesh}?)" in done.stderr
    assert "did you mean" not in command("bake", tmp_path / "dragon.stl").stderr


@pytest.mark.parametrize("name", ["bake", "spheres"])
def test_several_meshes_are_for_a_batch(name, tmp_path, command):
    meshes = [write_ring(tmp_path / f"{letter}.obj") for letter in "ab"]
    done = command(name, *meshes)
    assert done.returncode == 2
    assert f"{name} takes one mesh, but found {meshes[1]} as well; for many: aoprecalc batch MESH..." in done.stderr


def test_a_mesh_in_the_place_of_the_command(command):
    done = command("my spot.OBJ")
    assert done.returncode == 2
    assert "(did you mean `aoprecalc bake 'my spot.OBJ'`?)" in done.stderr


def test_the_names_of_parts(tmp_path, command):
    maker = GltfMaker(tmp_path)
    for number in range(12):
        maker.node(mesh=maker.mesh(corner(maker, APART)), name=f"Fabric {number:02}" if number else "Fabric")
    mesh = maker.save("sofa.glb")
    done = command("bake", mesh, "--only", "fabric")
    assert done.returncode == 2
    assert (
        "--only has 'fabric', which is not the name of a part (did you mean 'Fabric'?); expected one of " in done.stderr
    )
    assert "'Fabric 09' or " in done.stderr
