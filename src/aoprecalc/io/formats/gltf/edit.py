"""Give the baked primitives of a glTF document their UVs and normals; everything else stays as it is."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import deepcopy
from itertools import chain, repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted, one_or_many
from aoprecalc.io.formats.base import MeshWithAo
from aoprecalc.io.formats.builder import check_indices
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, float_values, raw_rows, view_bytes
from aoprecalc.io.formats.gltf.materials import PORTABLE_UV_SETS, new_uv_set, replaced_uv_sets, uv_sets_of_extensions
from aoprecalc.io.formats.gltf.nodes import INSTANCING
from aoprecalc.io.formats.gltf.occlusion_textures import BakedSlot, PrimitiveKey, follow_copies
from aoprecalc.io.formats.gltf.reader import PrimitiveSource, morph_weights
from aoprecalc.io.formats.gltf.references import GltfBuffer, numbers_of_unknown_extensions, unknown_extensions
from aoprecalc.io.formats.gltf.vertices import (
    OUTLINE,
    TANGENT,
    flip_v,
    local_normals,
    local_tangents,
    move_outline,
    name_features,
    perpendicular,
    vertex_attribute,
)
from aoprecalc.mesh.topology import corners_to_vertices
from aoprecalc.progress import Note
from aoprecalc.types import REVERSED_WINDING, Float32Array, Part, Scene


def edit_document(
    document: GltfDocument, mesh: MeshWithAo
) -> tuple[Json, GltfBuffer, dict[PrimitiveKey, BakedSlot], tuple[str, ...]]:
    """Return a copy of the scene's document with the UVs of the bake, its normals and its values at vertices.

    Vertices of the parts that receive are split along new seams; their other attributes and morph targets are copied
    byte by byte. Instances of a mesh with separate UV regions become separate meshes. Where the file's own UVs and
    normals were used, no vertex changes. A primitive whose faces have several textures becomes several, each with some
    of its triangles.

    Returns (json, buffer, slots, messages); `slots` is (mesh, primitive) -> its texture and UVs.
    """
    scene, normals, vertices = mesh.scene, mesh.normals, mesh.vertices
    json = deepcopy(document.json)
    receiving = [part if part.receives else None for part in scene.parts]
    changed_normals = {part for part in filter(None, receiving) if _normals_differ(document, scene, part, normals)}
    all_kept = all(texture.atlas.uv_set is not None for texture in mesh.textures)
    if all_kept and not changed_normals and vertices is None and mesh.tangents is None:
        keys = _separate_meshes(json, scene.parts, receiving, separate=False)
        buffer, slots = _carry_views(document, json, set(), set()), dict[PrimitiveKey, BakedSlot]()
        first = dict[PrimitiveKey, Part]()
        for part, key in keys.items():
            first.setdefault(key, part)  # instances have one primitive
        for key, part in first.items():
            triangles = part.vertices[:, REVERSED_WINDING] if _source(part).mirrored else part.vertices
            slots |= dict(_assign_slots(json, buffer, mesh, part, key, triangles))
        return json, buffer, slots, _messages(document, json, scene, slots, ())

    uv_owners = [scene.parts[part.uv_owner] if part.uv_owner is not None else part for part in scene.parts]
    owners = [owner if owner.receives else None for owner in uv_owners]
    keys = _separate_meshes(json, scene.parts, owners, separate=True)
    originals = {part: _primitive(document.json, _key(part)) for part in keys}
    for key in keys.values():
        _primitive(json, key).update(attributes={}, targets=[], indices=None)
        _primitive(json, key).get("extensions", {}).pop(OUTLINE, None)
    still_used = set(_accessors_used(json))
    free = {index for original in originals.values() for index in _primitive_accessors(original)} - still_used
    buffer = _carry_views(document, json, free, _unused_views(json, free))

    slots, messages, unwrapped = {}, list[str](), list[tuple[Json, int]]()
    needed = uv_sets_of_extensions(json)
    for part, key in keys.items():
        original, added, new_set = originals[part], dict[str, Float32Array](), None
        texture = mesh.textures[mesh.owners[part.start : part.stop].max(initial=-1)]
        if texture.atlas.uv_set is None:
            new_set = new_uv_set(document, original, needed)
            unwrapped.append((original, new_set))
            added = {f"TEXCOORD_{new_set}": flip_v(mesh.uvs[part.faces])}
        if vertices is not None:
            added |= vertex_attribute(vertices, part.faces, original["attributes"])
        new_normals = normals[part.faces] if part in changed_normals else None
        if mesh.tangents is not None and TANGENT not in original["attributes"]:
            added[TANGENT] = local_tangents(_source(part), part, mesh.tangents[part.faces])
            if "NORMAL" not in original["attributes"]:
                new_normals = normals[part.faces]
        primitive, triangles = _rewrite(document, buffer, part, original, added, new_normals)
        json["meshes"][key[0]]["primitives"][key[1]] = primitive
        slots |= dict(_assign_slots(json, buffer, mesh, part, key, triangles, new_set))
    if unwrapped:
        messages += replaced_uv_sets(document, unwrapped)
    messages += _lost_normals(document, changed_normals & keys.keys())
    return json, buffer, slots, (*messages, *_messages(document, json, scene, slots, list(keys)))


def _assign_slots(
    json: Json,
    buffer: GltfBuffer,
    mesh: MeshWithAo,
    part: Part,
    key: PrimitiveKey,
    triangles: NDArray[Any],
    new_set: int | None = None,
) -> Iterator[tuple[PrimitiveKey, BakedSlot]]:
    """Yield the slot of a part's primitive; of each of several that it becomes where it has several textures.

    triangles   (n, 3) the vertices of its faces, as indices of the primitive
    new_set     the n of the TEXCOORD_n of new UVs; None where those of the file are used
    """
    primitive, owners, primitives = _primitive(json, key), mesh.owners[part.faces], json["meshes"][key[0]]["primitives"]
    for number, index in enumerate(np.unique(owners)):
        own = key
        if number:
            own = (key[0], len(primitives))
            primitives.append(deepcopy(primitive))
        if len(np.unique(owners)) > 1:
            primitives[own[1]]["indices"] = buffer.add_indices(triangles[owners == index])
            primitives[own[1]].pop("mode", None)
        uv_set = mesh.textures[index].atlas.uv_set if new_set is None else new_set
        if index >= 0 and f"TEXCOORD_{uv_set}" in primitive["attributes"]:  # a part without area may lack it
            yield own, BakedSlot(int(index), uv_set)


def _messages(
    document: GltfDocument, json: Json, scene: Scene, slots: dict[PrimitiveKey, BakedSlot], rewritten: Collection[Part]
) -> tuple[str, ...]:
    """Return a note on duplicated meshes, and warnings of UV sets that viewers may ignore and of doubtful extensions.

    rewritten   the parts whose vertices were replaced
    """
    messages = list[str]()
    more_meshes = len(json["meshes"]) - len(document.json["meshes"])
    if more_meshes:
        shared = any(part.uv_owner is not None for part in scene.parts)
        hint = "" if shared else " (--instances share keeps them together)"
        became = one_or_many(more_meshes, "became a mesh of its own", "became separate meshes")
        messages.append(Note(f"{counted(more_meshes, 'instance')} {became}{hint}"))
    beyond = sum(slot.texcoord >= PORTABLE_UV_SETS for slot in slots.values())
    if beyond:
        use = f"{counted(beyond, 'primitive')} {one_or_many(beyond, 'uses', 'use')}"
        messages.append(f"{use} TEXCOORD_2 or beyond, which not every viewer supports")
    holders = [
        (document.json["meshes"][_source(part).mesh], _primitive(document.json, _key(part))) for part in rewritten
    ]
    unknown = unknown_extensions(name for holder in chain(*holders) for name in holder.get("extensions", {}))
    if unknown:
        messages.append(f"primitives have {', '.join(unknown)}, which may refer to vertices that were replaced")
    return tuple(messages)


def _lost_normals(document: GltfDocument, parts: Collection[Part]) -> Iterator[str]:
    """Yield a warning about morph targets of parts with new normals, where `_rewrite` drops their normals."""
    lost = sum(any(weight and "NORMAL" in target for target, weight in _targets(document, part)) for part in parts)
    if lost:
        have = one_or_many(lost, "has", "have")
        yield f"{counted(lost, 'primitive')} {have} new normals in the pose of the file, which its morph targets keep"


def _targets(document: GltfDocument, part: Part) -> list[tuple[Json, float]]:
    """Return the morph targets of a part's primitive with their weights in the pose of the file."""
    targets: list[Json] = _primitive(document.json, _key(part)).get("targets", [])
    weights = morph_weights(document.entry("nodes", _source(part).node), document.entry("meshes", _source(part).mesh))
    return [(target, weight) for target, weight in zip(targets, chain(weights, repeat(0.0)), strict=False)]


def _rewrite(
    document: GltfDocument,
    buffer: GltfBuffer,
    part: Part,
    original: Json,
    new_values: Mapping[str, Float32Array],
    normals: Float32Array | None,
) -> tuple[Json, NDArray[Any]]:
    """Return a copy of a primitive with new vertices in the buffer, split where their new values or tangents differ.

    Also returns its (n, 3) triangles.

    new_values   (n, 3, c), such as UVs, by the name of their attribute
    normals      (n, 3, 3) in world space; None: those of the file stay
    """
    source, values = _source(part), dict[str, Any](new_values)
    if normals is not None:
        values["NORMAL"] = local_normals(source, part, normals)
        if TANGENT in original["attributes"]:
            tangents = float_values(document, original["attributes"][TANGENT])
            check_indices(document.path, part.vertices, len(tangents))
            values[TANGENT] = perpendicular(tangents[part.vertices], values["NORMAL"])
    split = corners_to_vertices(part.vertices, *values.values())
    vertices = part.vertices.reshape(-1)[split.corner]

    def gather(index: int, *, zero: bool = False) -> int:
        accessor, rows = document.entry("accessors", index), raw_rows(document, index)
        check_indices(document.path, vertices, len(rows))
        add = buffer.add_rows if "bufferView" in accessor else buffer.add_sparse_rows
        return buffer.inherit(add(accessor, rows[vertices] * (not zero)), document, index)

    attributes = {name: gather(index) for name, index in original["attributes"].items() if name not in values}
    for name, corner_values in values.items():
        added = buffer.add_floats(corner_values.reshape(len(part.vertices) * 3, -1)[split.corner])
        attributes[name] = buffer.inherit(
            added, document, None if name in new_values else original["attributes"].get(name)
        )
    triangles = split.triangles[:, REVERSED_WINDING] if source.mirrored else split.triangles
    indices = buffer.inherit(buffer.add_indices(triangles), document, original.get("indices"))
    primitive = deepcopy(original) | {"attributes": attributes, "indices": indices}
    primitive.pop("mode", None)
    if "targets" in original:
        # The new normals belong to the shape in the pose of the file already.
        primitive["targets"] = [
            {
                name: gather(index, zero=bool(weight) and name == "NORMAL" and name in values)
                for name, index in target.items()
            }
            for target, weight in _targets(document, part)
        ]
    name_features(buffer, primitive, vertices)
    move_outline(document, buffer, primitive, part.vertices, split.triangles)
    return primitive, triangles


def _normals_differ(document: GltfDocument, scene: Scene, part: Part, normals: Float32Array) -> bool:
    """Tell whether the shading normals of a part differ from those stored in its file."""
    if scene.normals is None or not np.array_equal(scene.normals[part.faces], normals[part.faces]):
        return True
    attributes = _primitive(document.json, _key(part))["attributes"]
    if "NORMAL" not in attributes:
        return False
    values = float_values(document, attributes["NORMAL"])
    return not (np.isfinite(values).all(axis=1) & values.any(axis=1)).all()


def _separate_meshes(
    json: Json, parts: Sequence[Part], vertex_owners: Sequence[Part | None], *, separate: bool
) -> dict[Part, PrimitiveKey]:
    """Give each node that needs other vertices or materials than the rest of its mesh's nodes a copy of the mesh.

    vertex_owners   for each part the part whose new vertices its primitive gets; None: it keeps those of the file
    separate        different owners need different meshes; else it only matters whether there is an owner

    Returns the primitive of each owner.
    """
    owners_of_node: dict[int, dict[int, Part | None]] = {}  # node -> primitive -> owner
    mesh_of: dict[int, int] = {}
    for part, owner in zip(parts, vertex_owners, strict=True):
        source = _source(part)
        owners_of_node.setdefault(source.node, {})[source.primitive] = owner
        mesh_of[source.node] = source.mesh
    for node, entry in enumerate(json.get("nodes", [])):  # nodes outside the scene keep their mesh
        if node not in owners_of_node and entry.get("mesh") is not None:
            owners_of_node[node], mesh_of[node] = {}, entry["mesh"]

    copies = list[tuple[int, int]]()
    mesh_for: dict[tuple[int, tuple[tuple[int, Part | bool], ...]], int] = {}
    taken: set[int] = set()
    keys: dict[Part, PrimitiveKey] = {}
    # Nodes without owners come first, so that the original mesh is theirs.
    for node in sorted(owners_of_node, key=lambda node: any(owners_of_node[node].values())):
        mesh = mesh_of[node]
        owners = {primitive: owner for primitive, owner in owners_of_node[node].items() if owner is not None}
        variant = mesh, tuple((primitive, owner if separate else True) for primitive, owner in sorted(owners.items()))
        if variant not in mesh_for:
            mesh_for[variant] = mesh
            if mesh in taken:
                json["meshes"].append(deepcopy(json["meshes"][mesh]))
                mesh_for[variant] = len(json["meshes"]) - 1
                copies.append((mesh, mesh_for[variant]))
            taken.add(mesh)
        json["nodes"][node]["mesh"] = mesh_for[variant]
        for primitive, owner in owners.items():
            keys.setdefault(owner, (mesh_for[variant], primitive))
    follow_copies(json, "meshes", copies)
    return keys


# Under the last three EXT_structural_metadata names the views of its tables.
_VIEW_NAMES = ("bufferView", "values", "arrayOffsets", "stringOffsets")


def _carry_views(document: GltfDocument, json: Json, free_accessors: set[int], free_views: set[int]) -> GltfBuffer:
    """Return a buffer with the bytes of all views except the free ones."""
    buffer = GltfBuffer(json, tuple(sorted(free_accessors)), tuple(sorted(free_views)))
    for index, view in enumerate(json.get("bufferViews", [])):
        if index in free_views:
            json["bufferViews"][index] = None  # to be reused
        else:
            view.update(buffer=0, byteOffset=buffer.append(view_bytes(document, index)))
    return buffer


def _unused_views(json: Json, free_accessors: set[int]) -> set[int]:
    """Return the buffer views that only the given accessors refer to."""
    accessors = json.get("accessors", [])
    others = {key: value for key, value in json.items() if key != "accessors"}
    kept = [accessor for index, accessor in enumerate(accessors) if index not in free_accessors]
    needed = set(_buffer_views([others, *kept]))
    return set(_buffer_views([accessors[index] for index in free_accessors])) - needed


def _buffer_views(value: Any) -> Iterator[int]:
    """Yield every buffer view that a JSON value refers to, in extensions as well."""
    if isinstance(value, dict):
        yield from (value[name] for name in _VIEW_NAMES if isinstance(value.get(name), int))
        for member in value.values():
            yield from _buffer_views(member)
    elif isinstance(value, list):
        for member in value:
            yield from _buffer_views(member)


def _accessors_used(json: Json) -> Iterator[int]:
    for mesh in json["meshes"]:
        for primitive in mesh["primitives"]:
            yield from _primitive_accessors(primitive)
    for skin in json.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin["inverseBindMatrices"]
    for animation in json.get("animations", []):
        for sampler in animation["samplers"]:
            yield from (sampler["input"], sampler["output"])
    for node in json.get("nodes", []):
        yield from node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {}).values()
    yield from numbers_of_unknown_extensions(json)


def _primitive_accessors(primitive: Json) -> Iterator[int]:
    yield from primitive["attributes"].values()
    for target in primitive.get("targets", []):
        yield from target.values()
    if primitive.get("indices") is not None:
        yield primitive["indices"]
    if OUTLINE in primitive.get("extensions", {}):
        yield primitive["extensions"][OUTLINE]["indices"]


def _source(part: Part) -> PrimitiveSource:
    assert isinstance(part.source, PrimitiveSource)  # the reader made it
    return part.source


def _key(part: Part) -> PrimitiveKey:
    return _source(part).mesh, _source(part).primitive


def _primitive(json: Json, key: PrimitiveKey) -> Json:
    primitive: Json = json["meshes"][key[0]]["primitives"][key[1]]
    return primitive
