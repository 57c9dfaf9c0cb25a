"""A bad MSFT_lod in a material was found after the whole bake; -1 gave the last material the occlusion."""

import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from gltf_kit.gltf_documents import STACKED, colored, corner, extend
from gltf_kit.gltf_maker import GltfMaker


@pytest.mark.parametrize("level", [99, -1, "a", True, 1.0])
def test_they_are_at_read(tmp_path, level):
    maker = GltfMaker(tmp_path)
    extend(maker, "MSFT_lod")
    colored(maker, name="coarse")
    fine = colored(maker, name="fine", extensions={"MSFT_lod": {"ids": [level]}})
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=fine)))
    with pytest.raises(
        InputError, match=f"MSFT_lod refers to entry '{level}' of materials, a whole number from 0 to 1 "
    ):
        load_scene(maker.save())
