"""A primitive counted as unlit by its own material alone: lit variants (KHR_materials_variants) were not baked."""

import pytest

from aoprecalc.api.bake import bake_file
from aoprecalc.errors import InputError
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_documents import APART, STACKED, colored, corner, extend
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues, holders

UNLIT = {"extensions": {"KHR_materials_unlit": {}}}


def saved(folder, uvs, *variants, own=UNLIT):
    """A corner with a material of its own and others as variants, and one that shares the last but receives nothing."""
    maker = GltfMaker(folder)
    extend(maker, "KHR_materials_variants", "KHR_materials_unlit")
    names = [{"name": str(at)} for at in range(len(variants))]
    maker.json["extensions"] = {"KHR_materials_variants": {"variants": names}}
    numbers = [colored(maker, name=str(at), **members) for at, members in enumerate([own, *variants])]
    mappings = [{"material": number, "variants": [at]} for at, number in enumerate(numbers[1:])]
    chosen = {"material": numbers[0], "extensions": {"KHR_materials_variants": {"mappings": mappings}}}
    maker.node(mesh=maker.mesh(corner(maker, uvs, **chosen)), name="room")
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=numbers[-1])), name="far", translation=[9, 0, 0])
    return maker.save()


def baked(source):
    options = BakeOptions(size=64, directions=32, exclude=("far",))
    return GltfValues(bake_file(source, source.parent / "out.glb", options=options).files.mesh)


@needs_validator
@pytest.mark.parametrize("uvs", [STACKED, APART], ids=["new UVs", "kept UVs"])
def test_the_lit_variants_are_baked(uvs, tmp_path):
    source = saved(tmp_path, uvs, {}, UNLIT, {})
    after = baked(source)
    room, far = (mesh["primitives"][0] for mesh in after.json["meshes"])
    shown = ["occlusionTexture" in after.material(holder) for holder in holders(room)]
    assert shown == [False, True, False, True]
    assert "occlusionTexture" not in after.material(far)  # it shares the last material, of which the room has a copy
    assert [after.material(holder)["name"] for holder in holders(room)] == ["0", "1", "2", "3"]
    assert new_issues(source, after.path) == []


def test_what_is_unlit_in_every_variant_is_not_baked(tmp_path):
    with pytest.raises(InputError, match="unlit"):
        baked(saved(tmp_path, STACKED, UNLIT))
