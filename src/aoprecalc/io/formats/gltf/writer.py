"""Write glTF 2.0, as .gltf with its buffer beside it or as one .glb."""

import json
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from aoprecalc.errors import counted
from aoprecalc.io.baked_options import bake_text, options_document
from aoprecalc.io.formats.archives import inner_path
from aoprecalc.io.formats.base import (
    MeshWithAo,
    SourceMaterial,
    TextureReference,
    VertexOcclusion,
    WrittenMesh,
    source_colors,
    source_frame,
    source_materials,
)
from aoprecalc.io.formats.gltf.compression import EXTENSIONS
from aoprecalc.io.formats.gltf.directional_textures import (
    add_directional,
    directional_references,
    earlier_references,
)
from aoprecalc.io.formats.gltf.document import BIN_CHUNK, BINARY_EXTENSIONS, JSON_CHUNK, MAGIC, GltfDocument, Json
from aoprecalc.io.formats.gltf.edit import edit_document
from aoprecalc.io.formats.gltf.images import (
    add_base_textures,
    add_orm_textures,
    add_texture,
    buffer_file,
    carry_images,
)
from aoprecalc.io.formats.gltf.occlusion_textures import (
    BakedSlot,
    OrmImage,
    PrimitiveKey,
    assign_textures,
    occlusion_extras,
    own_materials,
    pack_orm,
    replaced_references,
    texture_info,
)
from aoprecalc.io.formats.gltf.references import GltfBuffer, compact, release_references, unknown_extensions
from aoprecalc.io.formats.gltf.vertices import TANGENT, flip_v, kept_colors, vertex_attribute
from aoprecalc.io.formats.textures import MaterialUse, material_names, material_uses
from aoprecalc.io.images import read_image
from aoprecalc.io.outputs import Outputs
from aoprecalc.mesh.surface import local_origin
from aoprecalc.mesh.topology import corners_to_vertices
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import linear_from_srgb
from aoprecalc.types import Float32Array, Float64Array, Part, Scene


def new_document(mesh: MeshWithAo) -> tuple[Json, GltfBuffer, dict[PrimitiveKey, BakedSlot], dict[int, SourceMaterial]]:
    """Return (json, buffer, slots, sources) for a scene of another format; a node and a mesh for name and material.

    Positions are rounded to float32, if they are far away about a local origin that a node above all moves there.
    Materials keep their colour and opacity; for their textures see `add_base_textures`. The colours of vertices become
    COLOR_0. The file's first UV set is kept: before the new set if a texture needs it, else after it, since simple
    viewers read the first set only. Parts that do not receive get only the file's UVs and normals.
    `slots` is (mesh, primitive) -> its texture and UVs, for primitives that have a texture.
    `sources` is index of a material -> the one that it is made from.
    """
    json: Json = {"asset": {"version": "2.0", "generator": "aoprecalc"}, "scene": 0, "scenes": [{"nodes": []}]}
    json |= {"nodes": [], "meshes": [], "materials": []}
    buffer = GltfBuffer(json)
    scene, normals = mesh.scene, mesh.normals
    known = source_materials(scene)
    uses = material_uses(mesh.parts, mesh.owners)
    names = material_names(uses, known, mesh.textures)
    materials: dict[MaterialUse, int] = {}
    sources: dict[int, SourceMaterial] = {}
    slots = {}
    origin = local_origin(scene.positions)
    colors = source_colors(scene)
    groups: dict[tuple[str, MaterialUse], list[Part]] = {}
    for part, use in zip(mesh.parts, uses, strict=True):
        groups.setdefault((part.name, use), []).append(part)
    for (name, use), parts in groups.items():
        baked = use[1] >= 0
        material = known.get(use[0] or "", SourceMaterial(""))
        if use not in materials:
            materials[use] = len(json["materials"])
            json["materials"].append(_material(names[use], material, textured=bool(material.texture and scene.uv_sets)))
            sources[materials[use]] = material

        own, new = scene.uv_sets[:1], [mesh.uvs] if baked and mesh.textures[use[1]].atlas.uv_set != 0 else []
        uv_sets = [*own, *new] if material.pictured else [*new, *own]
        ao = mesh.vertices if baked else None
        tangents = mesh.tangents if baked else None
        own_normals = normals if baked else scene.normals
        primitive = _primitive(buffer, scene, origin, parts, own_normals, tangents, uv_sets, colors, ao)
        if baked:
            slots[len(json["meshes"]), 0] = BakedSlot(use[1], len(own) if new and material.pictured else 0)
        json["scenes"][0]["nodes"].append(len(json["nodes"]))
        json["nodes"].append({"name": _valid_unicode(name), "mesh": len(json["meshes"])})
        json["meshes"].append({"name": _valid_unicode(name), "primitives": [primitive | {"material": materials[use]}]})
    if origin.any():
        json["nodes"].append(
            {"name": "local origin", "translation": origin.tolist(), "children": json["scenes"][0]["nodes"]}
        )
        json["scenes"][0]["nodes"] = [len(json["nodes"]) - 1]
    return json, buffer, slots, sources


def show_textures(json: Json, materials: Mapping[int, BakedSlot], textures: Mapping[int, int]) -> dict[int, BakedSlot]:
    """Make the baked texture the base colour, too, of materials without one: simple viewers show only that.

    materials   index of a material -> its texture and UVs; returned for those that show it
    textures    index of a material -> index of its texture in the document
    """
    shown = {}
    for index, slot in materials.items():
        color = json["materials"][index]["pbrMetallicRoughness"]
        if "baseColorTexture" not in color:
            color["baseColorTexture"] = texture_info(textures[index], slot.texcoord)
            shown[index] = slot
    return shown


def _primitive(
    buffer: GltfBuffer,
    scene: Scene,
    origin: Float64Array,
    parts: Sequence[Part],
    normals: Float32Array | None,
    tangents: Float32Array | None,
    uv_sets: Sequence[Float64Array],
    colors: Float32Array | None,
    vertices: VertexOcclusion | None,
) -> Json:
    """Return a primitive of the faces of some parts, about an origin; the other values are those of all faces."""
    faces = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    values = {} if normals is None else {"NORMAL": normals[faces]}
    values |= {} if tangents is None else {TANGENT: tangents[faces]}
    values |= {f"TEXCOORD_{number}": flip_v(uvs[faces]) for number, uvs in enumerate(uv_sets)}
    values |= {} if colors is None else {"COLOR_0": colors[faces]}
    values |= {} if vertices is None else vertex_attribute(vertices, faces, values)
    split = corners_to_vertices(scene.faces[faces], *values.values())
    positions = scene.positions[scene.faces[faces].reshape(-1)[split.corner]] - origin
    attributes = {"POSITION": buffer.add_floats(positions, bounded=True)}
    for name, array in values.items():
        attributes[name] = buffer.add_floats(array.reshape(-1, array.shape[2])[split.corner])
    return {"attributes": attributes, "indices": buffer.add_indices(split.triangles)}


def _material(name: str, material: SourceMaterial, *, textured: bool) -> Json:
    factor = [*material.factor(textured=textured), material.opacity]
    color: Json = {"baseColorFactor": factor}
    color |= {"metallicFactor": material.metalness, "roughnessFactor": material.roughness}
    made: Json = {"name": _valid_unicode(name), "pbrMetallicRoughness": color}
    if any(material.emission):
        made["emissiveFactor"] = linear_from_srgb(np.array(material.emission)).tolist()
    if material.alpha_mode != "OPAQUE":
        made["alphaMode"] = material.alpha_mode
    if material.double_sided:
        made["doubleSided"] = True
    return made


def _valid_unicode(name: str) -> str:
    """Return a name with the replacement character for bytes that are not UTF-8."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def write_gltf(outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
    """Write a .gltf or .glb with the textures as occlusion textures.

    The document of a glTF source is otherwise kept. A scene from another format gets a new document, in which the
    texture is also the base colour of materials that have no texture of their own.
    """
    scene = mesh.scene
    is_new = not isinstance(scene.document, GltfDocument)
    messages, sources = list[str](), dict[int, SourceMaterial]()
    source = inner_path(scene.path)
    if isinstance(scene.document, GltfDocument):
        source = scene.document.path
        document, buffer, slots, notes = edit_document(scene.document, mesh)
        messages += notes
    else:
        document, buffer, slots, sources = new_document(mesh)
        messages += source_frame(scene)
    materials, notes = own_materials(document, slots, mesh.strength, [texture.name for texture in mesh.textures])
    messages += notes
    if isinstance(scene.document, GltfDocument):
        messages += _numbers_told(scene.document.json, document)
    texts = [bake_text(mesh.options, len(scene.faces), texture.certificate) for texture in mesh.textures]
    packed, shown = dict[int, OrmImage](), dict[int, BakedSlot]()
    users = [[one for one, slot in materials.items() if slot.texture == index] for index in range(len(mesh.textures))]
    if mesh.pack == "orm":
        so_far = GltfDocument(source, document, (buffer.data,))
        for texture, users_of_it, text in zip(mesh.textures, users, texts, strict=True):
            of_it = {index: materials[index].texcoord for index in users_of_it}
            image = read_image(outputs.written(texture.path))
            packed_with_it, notes = pack_orm(so_far, of_it, texture.atlas, image, text)
            packed |= packed_with_it
            messages += notes

    said = [options_document(mesh.options, texture.certificate) for texture in mesh.textures]
    extras = occlusion_extras(document, {index: said[slot.texture] for index, slot in materials.items()})
    replaced = (*replaced_references(document, materials, packed), *earlier_references(document, list(materials)))
    release_references(document, buffer, replaced)
    if is_new:
        if (lost := len(scene.uv_sets) - (2 if any(one.atlas.uv_set for one in mesh.textures) else 1)) > 0:
            sets = counted(lost, "further UV set")
            messages.append(Note(f"{path}: {sets} of {scene.path.name} left out, which no picture in it uses"))
        if scene.uv_sets:
            messages += add_base_textures(outputs, path, document, buffer, sources, source)
        elif textured := [material.name for material in sources.values() if material.pictured]:
            found = f"{scene.path.name} has no UVs for the textures of its materials"
            messages.append(f"{path}: {found} ({', '.join(textured[:3])}): they are left out")
    else:
        messages += carry_images(outputs, path, document, buffer, source)
    textures = dict[int, int]()
    for texture, users_of_it, text in zip(mesh.textures, users, texts, strict=True):
        images = {index: packed[index] for index in users_of_it if index in packed}
        textures |= add_orm_textures(outputs, path, document, buffer, texture.path, images)
        if len(images) < len(users_of_it):
            repeats = texture.repeats(scene)
            number, notes = add_texture(outputs, path, document, buffer, texture.path, text, repeats=repeats)
            messages += notes
            textures = dict.fromkeys(users_of_it, number) | textures
    if is_new and not (mesh.vertices and mesh.vertices.as_color):  # both would darken the colour twice
        shown = show_textures(document, materials, textures)
    assign_textures(document, materials, textures, packed, extras, mesh.strength)
    messages += add_directional(outputs, path, document, buffer, mesh, materials)
    if mesh.vertices and mesh.vertices.as_color:
        messages += kept_colors(path, document)
    compact(document)
    messages += _write(outputs, path, document, buffer.data)
    references = _references(materials, shown, packed, mesh.strength)
    return WrittenMesh((*references, *directional_references(document, list(materials))), tuple(messages))


def _numbers_told(before: Json, after: Json) -> Iterator[str]:
    """Yield a warning about extensions of a document that may need to know of materials and meshes that were added."""
    names = unknown_extensions(before.get("extensions", {}))
    nouns = {"materials": ("material", "materials"), "meshes": ("mesh", "meshes")}
    more = {kind: len(after.get(kind, [])) - len(before.get(kind, [])) for kind in nouns}
    added = " and ".join(counted(number, *nouns[kind]) for kind, number in more.items() if number)
    if names and added:
        yield f"{', '.join(names)} may refer to materials and meshes by number; {added} of the result are new to it"


def _references(
    materials: Mapping[int, BakedSlot],
    shown: Mapping[int, BakedSlot],
    packed: Mapping[int, OrmImage],
    strength: float,
) -> tuple[TextureReference, ...]:
    """Count the materials that refer to a texture; the maps are from their indices to that and its UVs."""
    uses = Counter(("occlusionTexture", slot.texcoord, index in packed) for index, slot in materials.items())
    uses.update(("baseColorTexture", slot.texcoord, False) for slot in shown.values())
    return tuple(
        TextureReference(
            slot, f"TEXCOORD_{texcoord}", count, is_packed, float(strength) if slot == "occlusionTexture" else None
        )
        for (slot, texcoord, is_packed), count in uses.items()
    )


def _write(outputs: Outputs, path: Path, document: Json, data: bytes) -> tuple[str, ...]:
    """Write the document with all data in one buffer; return a warning about names and extras of others."""
    said = list(filter(None, map(_said, document.get("buffers", []))))
    document["buffers"] = [{"byteLength": len(data), **(said[0] if said else {})}]
    warning = f"{path}: one buffer replaces those of the file; it keeps the name and extras of the first"
    warnings = (warning,) if len(said) > 1 else ()
    if path.suffix.lower() in BINARY_EXTENSIONS:
        text = json.dumps(document, separators=(",", ":")).encode()
        outputs.path(path).write_bytes(glb(text, data))
        return warnings
    binary = buffer_file(path)
    document["buffers"][0] = {"uri": binary.name, **document["buffers"][0]}
    outputs.path(binary).write_bytes(data)
    outputs.path(path).write_bytes(json.dumps(document, indent=1).encode() + b"\n")
    return warnings


def _said(buffer: Json) -> Json:
    """Return what a buffer says beside where its bytes are: name, extras, extensions but for compression."""
    members = {key: value for key, value in buffer.items() if key not in ("uri", "byteLength", "extensions")}
    extensions = {name: value for name, value in buffer.get("extensions", {}).items() if name not in EXTENSIONS}
    return members | ({"extensions": extensions} if extensions else {})


def glb(text: bytes, data: bytes) -> bytes:
    """Return a GLB: a chunk with the JSON text and a chunk with the binary data, which may be empty."""
    chunks = b""
    for chunk_type, content, padding in ((JSON_CHUNK, text, b" "), (BIN_CHUNK, data, b"\0")):
        padded = content + padding * (-len(content) % 4)
        chunks += struct.pack("<II", len(padded), chunk_type) + padded
    return MAGIC + struct.pack("<II", 2, 12 + len(chunks)) + chunks
