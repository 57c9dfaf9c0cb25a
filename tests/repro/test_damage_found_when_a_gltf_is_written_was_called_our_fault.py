"""What the reader of a glTF does not need, such as an animation or a second colour, may be damaged and is met when the
document is written back: "a fault of aoprecalc". It is damage of the file.
"""

import copy
import json

import numpy as np
import pytest

from aoprecalc.errors import AoprecalcError, InputError
from aoprecalc.io import load_scene
from gltf_kit.baked_by_hand import write_with_texture
from gltf_kit.gltf_documents import STACKED, animate, corner
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_random import random_document

WRONG = [None, 99, -1, "x", [], {}, [1], {"a": 1}]


def places(value, at=()):
    """The path of keys to each member of a JSON value."""
    for key, member in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*at, key)
        if isinstance(member, dict | list):
            yield from places(member, (*at, key))


def damaged(document, place, value):
    document = copy.deepcopy(document)
    holder = document
    for key in place[:-1]:
        holder = holder[key]
    holder[place[-1]] = value
    return document


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[] if seed < 2 else [pytest.mark.slow]) for seed in range(30)]
)
def test_damage_of_any_member_is_damage_of_the_file(seed, tmp_path):
    maker, rng = GltfMaker(tmp_path), np.random.default_rng(seed)
    random_document(maker, seed)
    path = maker.save("made.gltf", "made.bin")
    document = json.loads(path.read_text())
    members = list(places(document))
    told = []
    for number in range(12):
        place, value = members[rng.integers(len(members))], WRONG[rng.integers(len(WRONG))]
        path.write_text(json.dumps(damaged(document, place, value)))
        try:
            scene = load_scene(path)
            normals = scene.normals.astype(np.float32)
            write_with_texture(scene, tmp_path / "out" / f"{number}.glb", normals=normals)
        except AoprecalcError as error:
            told.append(str(error))
    assert told
    assert [message for message in told if str(path) not in message] == []


def test_the_message_says_what_is_wrong(tmp_path):
    maker = GltfMaker(tmp_path)
    maker.node(mesh=maker.mesh(corner(maker, STACKED)))
    animate(maker, 0, "translation", np.zeros((2, 3), "<f4"))
    del maker.json["animations"][0]["samplers"]
    scene = maker.load()
    with pytest.raises(InputError, match=r"it cannot be written back \(KeyError: 'samplers'\)"):
        write_with_texture(scene, tmp_path / "a.glb")
    assert not list(tmp_path.glob("a.*"))
