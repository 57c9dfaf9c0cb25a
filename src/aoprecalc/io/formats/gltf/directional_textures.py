"""Bent normals and spherical harmonics in a glTF document: its textures, named in the `extras` of materials.

glTF has no slot for them. A material with an occlusionTexture of the same bake says

    "extras": {"aoprecalc": {
        "bentNormalTexture": {"index": 1, "texCoord": 0, "space": "tangent", "green": "up"},
        "sphericalHarmonicsTexture": {"index": 2, "texCoord": 0, "space": "tangent", "green": "up"}
    }}

where `index` and `texCoord` are those of a textureInfo, and `space` and `green` are the options of the bake. The
textures are linear; their last three channels hold 0.5 v + 0.5 of a vector v, before which spherical harmonics have the
AO. As they are the document's own textures, a GLB has their pictures inside.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from aoprecalc.errors import counted, one_or_many
from aoprecalc.io.baked_options import EXTRAS
from aoprecalc.io.formats.base import MeshWithAo, TextureReference
from aoprecalc.io.formats.gltf.document import Json
from aoprecalc.io.formats.gltf.images import add_texture
from aoprecalc.io.formats.gltf.occlusion_textures import BakedSlot
from aoprecalc.io.formats.gltf.references import GltfBuffer, Reference
from aoprecalc.io.outputs import Outputs

_NAMES = {"bent normals": "bentNormalTexture", "spherical harmonics": "sphericalHarmonicsTexture"}


def earlier_references(document: Json, materials: Sequence[int]) -> Iterator[Reference]:
    """Yield (holder, key) of what materials say of the pictures of an earlier bake; it goes with their occlusion."""
    for index in materials:
        said = _said(document["materials"][index])
        yield from ((said, name) for name in _NAMES.values() if name in said)


def add_directional(
    outputs: Outputs,
    path: Path,
    document: Json,
    buffer: GltfBuffer,
    mesh: MeshWithAo,
    materials: Mapping[int, BakedSlot],
) -> tuple[str, ...]:
    """Add the pictures that go with baked textures to the document that will be at `path`, and name them in extras.

    materials   index of a material -> its baked texture and UVs

    Extras may be of any type: those that are no object are kept, and a warning tells that they name nothing.
    """
    without = list[int]()
    for number, texture in enumerate(mesh.textures):
        users = {index: slot for index, slot in materials.items() if slot.texture == number}
        unfit = [index for index in users if not isinstance(document["materials"][index].get("extras", {}), dict)]
        without += unfit if texture.directional else []
        found: dict[str, Json] = {}
        for picture in texture.directional if len(users) > len(unfit) else ():
            repeats = texture.repeats(mesh.scene)
            entry, _ = add_texture(outputs, path, document, buffer, picture.path, "", repeats=repeats)
            info = {"index": entry, "texCoord": 0, "space": picture.space, "green": picture.green}
            found[_NAMES[picture.holds]] = info
        for index, slot in users.items():
            if index not in unfit:
                own = {name: info | {"texCoord": slot.texcoord} for name, info in found.items()}
                _say(document["materials"][index], own)
    if not without:
        return ()
    have = f"{counted(len(without), 'material')} {one_or_many(len(without), 'has', 'have')}"
    return (f"{path}: {have} extras that are no object, so that they do not name the pictures of directions",)


def directional_references(document: Json, materials: Sequence[int]) -> Iterator[TextureReference]:
    """Yield where materials name such pictures."""
    for name in _NAMES.values():
        uses = [info for index in materials if (info := _said(document["materials"][index]).get(name)) is not None]
        for texcoord in dict.fromkeys(info["texCoord"] for info in uses):
            number = sum(info["texCoord"] == texcoord for info in uses)
            yield TextureReference(f"extras.{EXTRAS}.{name}", f"TEXCOORD_{texcoord}", number)


def _said(material: Json) -> Json:
    """Return what this program said in the extras of a material."""
    extras = material.get("extras")
    said = extras.get(EXTRAS) if isinstance(extras, dict) else None
    return said if isinstance(said, dict) else {}


def _say(material: Json, own: Json) -> None:
    """Name pictures in the extras of a material, in place of those of an earlier bake."""
    kept = {name: value for name, value in _said(material).items() if name not in _NAMES.values()}
    extras = {name: value for name, value in material.get("extras", {}).items() if name != EXTRAS}
    if said := kept | own:
        extras[EXTRAS] = said
    if extras:
        material["extras"] = extras
    else:
        material.pop("extras", None)
