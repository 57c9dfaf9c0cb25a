"""Coarser materials (MSFT_lod) got no occlusion; what KHR_node_visibility hides was baked, and shaded the rest."""

import pytest

from aoprecalc.api.bake import bake_file
from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_documents import APART, STACKED, colored, corner, extend
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues

HIDDEN = {"extensions": {"KHR_node_visibility": {"visible": False}}}


def baked(source, **options):
    return bake_file(source, source.parent / "out.glb", options=BakeOptions(size=64, directions=32, **options))


@needs_validator
@pytest.mark.parametrize("uvs", [STACKED, APART], ids=["new UVs", "kept UVs"])
def test_every_level_of_a_material_gets_the_occlusion(uvs, tmp_path):
    maker = GltfMaker(tmp_path)
    extend(maker, "MSFT_lod")
    coarse, coarser, other = (colored(maker, name=name) for name in ("coarse", "coarser", "other"))
    fine = colored(maker, name="fine", extensions={"MSFT_lod": {"ids": [coarse, coarser]}})
    maker.node(mesh=maker.mesh(corner(maker, uvs, material=fine)), name="room")
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=coarse)), name="far", translation=[9, 0, 0])
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=other)), name="out", translation=[-9, 0, 0])
    source = maker.save()
    after = GltfValues(baked(source, only=("room",)).files.mesh)
    room, far, out = (after.material(mesh["primitives"][0]) for mesh in after.json["meshes"])
    levels = [after.json["materials"][index] for index in room["extensions"]["MSFT_lod"]["ids"]]
    assert [level["name"] for level in levels] == ["coarse", "coarser"]
    assert all(level["occlusionTexture"] == room["occlusionTexture"] for level in levels)
    assert "occlusionTexture" not in far  # it shares a coarse material, of which the room has a copy
    assert "occlusionTexture" not in out
    assert new_issues(source, after.path) == []


def rooms(folder, **members):
    """A room, and below a node with other members another that is closed over it."""
    maker = GltfMaker(folder)
    extend(maker, "KHR_node_visibility")
    mesh = maker.mesh(corner(maker, APART))
    inner = maker.node(mesh=mesh, name="lid", scale=[-1, -1, -1], translation=[1, 1, 1])
    maker.node(mesh=mesh, name="room")
    maker.node(children=[inner], name="group", **members)
    return maker.save()


def test_hidden_nodes_neither_receive_nor_occlude(tmp_path):
    source = rooms(tmp_path, **HIDDEN)
    scene = load_scene(source)
    assert [part.name for part in scene.parts] == ["room"]
    assert scene.notes == (
        "1 mesh of hidden nodes (KHR_node_visibility): left out, neither baked nor in the way of light",
    )
    open_room = baked(source).report.ao.mean
    shown = rooms(tmp_path, extensions={"KHR_node_visibility": {"visible": True}})
    assert len(load_scene(shown).parts) == 2
    assert open_room > baked(shown).report.ao.mean + 0.1


@needs_validator
def test_they_stay_in_the_file(tmp_path):
    source = rooms(tmp_path, **HIDDEN)
    done = baked(source)
    assert [node["name"] for node in GltfValues(done.files.mesh).json["nodes"]] == ["lid", "room", "group"]
    assert new_issues(source, done.files.mesh) == []


def test_a_file_of_which_all_is_hidden_is_told(tmp_path):
    maker = GltfMaker(tmp_path)
    maker.node(mesh=maker.mesh(corner(maker, APART)), **HIDDEN)
    with pytest.raises(InputError, match=r"all its faces are in 1 mesh of hidden nodes \(KHR_node_visibility\); show"):
        maker.load()
