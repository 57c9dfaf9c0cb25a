"""Changes a glTF document: the vertices of what was baked get UVs and normals, all else stays as it was."""

from collections.abc import Collection, Iterator, Sequence
from copy import deepcopy
from itertools import count
from typing import Any

import numpy as np

from aoprecalc.io.formats.builder import check_indices
from aoprecalc.io.formats.gltf.buffers import GltfBuffer
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, doubles, raw_rows, view_bytes
from aoprecalc.io.formats.gltf.occlusion_textures import VARIANTS, Place
from aoprecalc.io.formats.gltf.reader import INSTANCING, PrimitiveSource
from aoprecalc.mesh.topology import corners_to_vertices
from aoprecalc.types import REVERSED_WINDING, Atlas, Float32Array, Float64Array, Part, Scene

# Viewers must support TEXCOORD_0 and TEXCOORD_1 only.
SETS_EVERYWHERE = 2

# Extensions of primitives that do not count vertices.
_WITHOUT_VERTICES = {VARIANTS, "EXT_mesh_features", "EXT_structural_metadata"}


def edit_document(
    document: GltfDocument, scene: Scene, atlas: Atlas, normals: Float32Array
) -> tuple[Json, GltfBuffer, dict[Place, int], tuple[str, ...]]:
    """Return a copy of the scene's document that has the atlas's UVs and these normals.

    normals   (f, 3, 3) float32, in the world

    Vertices of the parts that receive are split along new seams, and everything they have (morph targets as well) goes
    along byte by byte. Instances of a mesh whose parts have places of their own in the atlas become meshes of their
    own. Where the file's own UVs and normals were used, no vertex is touched.

    Returns (json, buffer, sets, warnings): `sets` tells for each (mesh, primitive) which TEXCOORD_n the texture is for.
    """
    json = deepcopy(document.json)
    other_normals = {part for part in scene.parts if part.receives and _differs(document, scene, part, normals)}
    if atlas.uv_set is not None and not other_normals:
        places = _own_meshes(json, scene.parts, [part if part.receives else None for part in scene.parts], apart=False)
        name = f"TEXCOORD_{atlas.uv_set}"
        sets = {at: atlas.uv_set for at in places.values() if name in _primitive(json, at)["attributes"]}
        buffer = _carry_views(document, json, set(), set())
        return json, buffer, sets, _warnings(document, json, scene, sets, ())

    owners = [scene.parts[part.uv_owner] if part.uv_owner is not None else part for part in scene.parts]
    places = _own_meshes(json, scene.parts, [owner if owner.receives else None for owner in owners], apart=True)
    originals = {part: _primitive(document.json, _place(part)) for part in places}
    for place in places.values():
        _primitive(json, place).update(attributes={}, targets=[], indices=None)
    still_used = set(_accessors_used(json))
    free = {index for original in originals.values() for index in _primitive_accessors(original)} - still_used
    buffer = _carry_views(document, json, free, _views_freed(json, free))

    sets = {}
    for part, place in places.items():
        attributes = originals[part]["attributes"]
        free_set = next(number for number in count() if f"TEXCOORD_{number}" not in attributes)
        uv_set = free_set if atlas.uv_set is None else atlas.uv_set
        if atlas.uv_set is None or f"TEXCOORD_{uv_set}" in attributes:  # a part without area need not have it
            sets[place] = uv_set
        primitive = _rewrite(
            document,
            buffer,
            part,
            originals[part],
            atlas.uvs[part.faces] if atlas.uv_set is None else None,
            normals[part.faces] if part in other_normals else None,
            f"TEXCOORD_{free_set}",
        )
        json["meshes"][place[0]]["primitives"][place[1]] = primitive
    return json, buffer, sets, _warnings(document, json, scene, sets, list(originals.values()))


def _warnings(
    document: GltfDocument, json: Json, scene: Scene, sets: dict[Place, int], rewritten: Collection[Json]
) -> tuple[str, ...]:
    """Say what makes a document larger, or may not be right, or not in every viewer.

    rewritten   the primitives, as they were, that have other vertices now
    """
    said = []
    more_meshes = len(json["meshes"]) - len(document.json["meshes"])
    if more_meshes:
        together = any(part.uv_owner is not None for part in scene.parts)
        hint = "" if together else " (--instances share keeps them together)"
        said.append(f"{more_meshes} instances have become meshes of their own{hint}")
    far = sum(number >= SETS_EVERYWHERE for number in sets.values())
    if far:
        said.append(f"{far} primitives use TEXCOORD_2 or beyond, which not every viewer supports")
    unknown = {name for primitive in rewritten for name in primitive.get("extensions", {})} - _WITHOUT_VERTICES
    if unknown:
        said.append(f"primitives have {', '.join(sorted(unknown))}, which may count on the vertices of before")
    return tuple(said)


def _rewrite(
    document: GltfDocument,
    buffer: GltfBuffer,
    part: Part,
    original: Json,
    uvs: Float64Array | None,
    normals: Float32Array | None,
    uv_name: str,
) -> Json:
    """Return a primitive like the original, with new vertices in the buffer."""
    source = _source(part)
    values: dict[str, Any] = {}
    if normals is not None:
        values["NORMAL"] = _local_normals(source, part, normals)
    if uvs is not None:
        values[uv_name] = np.stack([uvs[:, :, 0], 1.0 - uvs[:, :, 1]], axis=2).astype(np.float32)
    split = corners_to_vertices(part.vertices, *values.values())
    vertices = part.vertices.reshape(-1)[split.corner]

    def pick(index: int, *, nothing: bool = False) -> int:
        rows = raw_rows(document, index)
        check_indices(document.path, vertices, len(rows))
        return buffer.add_rows(document.entry("accessors", index), rows[vertices] * (not nothing))

    attributes = {name: pick(index) for name, index in original["attributes"].items() if name not in values}
    for name, corner_values in values.items():
        attributes[name] = buffer.add_floats(corner_values.reshape(len(part.vertices) * 3, -1)[split.corner])
    triangles = split.triangles[:, REVERSED_WINDING] if source.mirrored else split.triangles
    primitive = deepcopy(original) | {"attributes": attributes, "indices": buffer.add_triangles(triangles)}
    primitive.pop("mode", None)
    if "targets" in original:
        # The new normals are those of the morphed shape already.
        primitive["targets"] = [
            {name: pick(index, nothing=name in values) for name, index in target.items()}
            for target in original["targets"]
        ]
    return primitive


def _differs(document: GltfDocument, scene: Scene, part: Part, normals: Float32Array) -> bool:
    """Tell whether a part is shaded with other normals than its file's, or the reader had to replace some of these."""
    if scene.normals is None or not np.array_equal(scene.normals[part.faces], normals[part.faces]):
        return True
    attributes = _primitive(document.json, _place(part))["attributes"]
    if "NORMAL" not in attributes:
        return False
    values = doubles(document, attributes["NORMAL"])
    return not (np.isfinite(values).all(axis=1) & values.any(axis=1)).all()


def _local_normals(source: PrimitiveSource, part: Part, normals: Float32Array) -> Float32Array:
    """Return world normals as the primitive's own: the transpose undoes what its cofactors did, up to length."""
    linear = source.linear[part.vertices] if source.linear.ndim == 3 else source.linear
    local = np.einsum("...ij,...i->...j", linear, normals.astype(np.float64))
    lengths = np.linalg.norm(local, axis=2, keepdims=True)
    return np.where(lengths > 0, local / np.where(lengths > 0, lengths, 1), normals).astype(np.float32)


def _own_meshes(json: Json, parts: Sequence[Part], holders: Sequence[Part | None], *, apart: bool) -> dict[Part, Place]:
    """Give nodes that show the same mesh with different places in the atlas a mesh each.

    holders   for each part the one whose vertices it shows; None: those of the file
    apart     holders of their own need meshes of their own; else all holders of a primitive are as good as one

    Returns where each holder's primitive is now.
    """
    shown: dict[int, dict[int, Part | None]] = {}  # of each node: its primitives' holders
    mesh_of: dict[int, int] = {}
    for part, holder in zip(parts, holders, strict=True):
        source = _source(part)
        shown.setdefault(source.node, {})[source.primitive] = holder
        mesh_of[source.node] = source.mesh
    for node, entry in enumerate(json.get("nodes", [])):  # nodes outside the scene keep what they show
        if node not in shown and entry.get("mesh") is not None:
            shown[node], mesh_of[node] = {}, entry["mesh"]

    made: dict[tuple[int, tuple[tuple[int, Part | bool], ...]], int] = {}
    taken: set[int] = set()
    places: dict[Part, Place] = {}
    for node in sorted(shown, key=lambda node: any(shown[node].values())):  # the file's own vertices come first
        mesh = mesh_of[node]
        look = {number: holder for number, holder in shown[node].items() if holder is not None}
        key = mesh, tuple((number, holder if apart else True) for number, holder in sorted(look.items()))
        if key not in made:
            made[key] = mesh
            if mesh in taken:
                json["meshes"].append(deepcopy(json["meshes"][mesh]))
                made[key] = len(json["meshes"]) - 1
            taken.add(mesh)
        json["nodes"][node]["mesh"] = made[key]
        for number, holder in look.items():
            places.setdefault(holder, (made[key], number))
    return places


def _carry_views(document: GltfDocument, json: Json, free_accessors: set[int], free_views: set[int]) -> GltfBuffer:
    """Start a buffer with the bytes of all views but the free ones."""
    buffer = GltfBuffer(json, tuple(sorted(free_accessors)), tuple(sorted(free_views)))
    for index, view in enumerate(json.get("bufferViews", [])):
        if index in free_views:
            json["bufferViews"][index] = None  # until something takes its place
        else:
            view.update(buffer=0, byteOffset=buffer.append(view_bytes(document, index)))
    return buffer


def _views_freed(json: Json, free_accessors: set[int]) -> set[int]:
    """Return the buffer views that only these accessors refer to."""
    accessors = json.get("accessors", [])
    others = {key: value for key, value in json.items() if key != "accessors"}
    needed = set(_buffer_views([others, *(entry for at, entry in enumerate(accessors) if at not in free_accessors)]))
    return set(_buffer_views([accessors[index] for index in free_accessors])) - needed


def _buffer_views(value: Any) -> Iterator[int]:
    """Yield every buffer view that is referred to within a JSON value, extensions included."""
    if isinstance(value, dict):
        if isinstance(value.get("bufferView"), int):
            yield value["bufferView"]
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


def _primitive_accessors(primitive: Json) -> Iterator[int]:
    yield from primitive["attributes"].values()
    for target in primitive.get("targets", []):
        yield from target.values()
    if primitive.get("indices") is not None:
        yield primitive["indices"]


def _source(part: Part) -> PrimitiveSource:
    assert isinstance(part.source, PrimitiveSource)  # the reader made it
    return part.source


def _place(part: Part) -> Place:
    return _source(part).mesh, _source(part).primitive


def _primitive(json: Json, place: Place) -> Json:
    primitive: Json = json["meshes"][place[0]]["primitives"][place[1]]
    return primitive
