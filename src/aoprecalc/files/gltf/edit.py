"""Changes a glTF document: the vertices of what was baked get UVs and normals, all else stays as it was."""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np

from aoprecalc.files.corners import split_corners
from aoprecalc.files.damage import check_indices
from aoprecalc.files.gltf.accessors import doubles, raw_rows, view_bytes
from aoprecalc.files.gltf.buffer import GltfBuffer
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.files.gltf.reader import GEOMETRY_EXTENSIONS, INSTANCING, GltfSource
from aoprecalc.model import Atlas, Doubles, Floats, Part, Scene

# Viewers must support TEXCOORD_0 and TEXCOORD_1 only.
SETS_EVERYWHERE = 2

Place = tuple[int, int]


def edit_document(
    document: GltfDocument, scene: Scene, atlas: Atlas, normals: Floats
) -> tuple[Json, GltfBuffer, dict[Place, int], tuple[str, ...]]:
    """Return a copy of the scene's document that has the atlas's UVs and these normals.

    normals   (f, 3, 3) float32, in the world

    Vertices are split along new seams, and everything they have (morph targets as well) goes along byte by byte.
    Instances of a mesh become meshes of their own, as each has its own place in the atlas. Where the file's own UVs
    and normals were used, no vertex is touched.

    Returns (json, buffer, sets, warnings): `sets` tells for each (mesh, primitive) which TEXCOORD_n the texture is for.
    """
    json = deepcopy(document.json)
    new_uvs = atlas.method != "keep"
    same_normals = scene.normals is not None and np.array_equal(scene.normals, normals)
    new_normals = not (same_normals and all(_has_whole_normals(document, part) for part in scene.parts))
    if not (new_uvs or new_normals):
        sets = {place: 0 for place in map(_place, scene.parts) if "TEXCOORD_0" in _primitive(json, place)["attributes"]}
        return json, _carry_views(document, json, set(), set()), sets, ()

    places = _own_meshes(json, scene.parts)
    originals = [_primitive(document.json, _place(part)) for part in scene.parts]
    for place in places:
        _primitive(json, place).update(attributes={}, targets=[], indices=None)
    still_used = set(_accessors_used(json))
    free = {index for original in originals for index in _primitive_accessors(original)} - still_used
    buffer = _carry_views(document, json, free, _views_freed(json, free))

    sets = {}
    for part, original, place in zip(scene.parts, originals, places, strict=True):
        attributes = original["attributes"]
        number = next(number for number in range(len(attributes) + 1) if f"TEXCOORD_{number}" not in attributes)
        if new_uvs or "TEXCOORD_0" in attributes:
            sets[place] = number if new_uvs else 0
        faces = slice(part.start, part.stop)
        primitive = _rewrite(
            document,
            buffer,
            part,
            original,
            atlas.uvs[faces] if new_uvs else None,
            normals[faces] if new_normals else None,
            f"TEXCOORD_{number}",
        )
        json["meshes"][place[0]]["primitives"][place[1]] = primitive
    far = sum(number >= SETS_EVERYWHERE for number in sets.values())
    warnings = (f"{far} primitives use TEXCOORD_2 or beyond, which not every viewer supports",) if far else ()
    return json, buffer, sets, warnings


def _rewrite(
    document: GltfDocument,
    buffer: GltfBuffer,
    part: Part,
    original: Json,
    uvs: Doubles | None,
    normals: Floats | None,
    uv_name: str,
) -> Json:
    """Return a primitive like the original, with new vertices in the buffer."""
    source = _source(part)
    values: dict[str, Any] = {}
    if normals is not None:
        values["NORMAL"] = _local_normals(source, part, normals)
    if uvs is not None:
        values[uv_name] = np.stack([uvs[:, :, 0], 1.0 - uvs[:, :, 1]], axis=2).astype(np.float32)
    split = split_corners(part.vertices, *values.values())
    vertices = part.vertices.reshape(-1)[split.corner]

    def pick(index: int) -> int:
        rows = raw_rows(document, index)
        check_indices(document.path, vertices, len(rows))
        return buffer.add_rows(document.entry("accessors", index), rows[vertices])

    attributes = {name: pick(index) for name, index in original["attributes"].items() if name not in values}
    for name, corner_values in values.items():
        attributes[name] = buffer.add_floats(corner_values.reshape(len(part.vertices) * 3, -1)[split.corner])
    triangles = split.triangles[:, [0, 2, 1]] if source.mirrored else split.triangles
    primitive = deepcopy(original) | {"attributes": attributes, "indices": buffer.add_triangles(triangles)}
    primitive.pop("mode", None)
    if "targets" in original:
        primitive["targets"] = [{name: pick(index) for name, index in target.items()} for target in original["targets"]]
    for extension in GEOMETRY_EXTENSIONS:
        primitive.get("extensions", {}).pop(extension, None)
    return primitive


def _has_whole_normals(document: GltfDocument, part: Part) -> bool:
    """Tell whether the reader had no normal of a part to replace."""
    values = doubles(document, _primitive(document.json, _place(part))["attributes"]["NORMAL"])
    return bool((np.isfinite(values).all(axis=1) & values.any(axis=1)).all())


def _local_normals(source: GltfSource, part: Part, normals: Floats) -> Floats:
    """Return world normals as the primitive's own: the transpose undoes what its cofactors did, up to length."""
    linear = source.linear[part.vertices] if source.linear.ndim == 3 else source.linear
    local = np.einsum("...ij,...i->...j", linear, normals.astype(np.float64))
    lengths = np.linalg.norm(local, axis=2, keepdims=True)
    return np.where(lengths > 0, local / np.where(lengths > 0, lengths, 1), normals).astype(np.float32)


def _own_meshes(json: Json, parts: tuple[Part, ...]) -> list[Place]:
    """Give every node that was baked a mesh of its own; return where each part's primitive is now."""
    owners: dict[int, int] = {}
    meshes: dict[int, int] = {}
    for source in map(_source, parts):
        if source.node in meshes:
            continue
        meshes[source.node] = source.mesh
        if owners.setdefault(source.mesh, source.node) != source.node:
            json["meshes"].append(deepcopy(json["meshes"][source.mesh]))
            meshes[source.node] = json["nodes"][source.node]["mesh"] = len(json["meshes"]) - 1
    return [(meshes[source.node], source.primitive) for source in map(_source, parts)]


def _carry_views(document: GltfDocument, json: Json, free_accessors: set[int], free_views: set[int]) -> GltfBuffer:
    """Start a buffer with the bytes of all views but the free ones."""
    buffer = GltfBuffer(json, tuple(sorted(free_accessors)), tuple(sorted(free_views)))
    for index, view in enumerate(json.get("bufferViews", [])):
        for extension in GEOMETRY_EXTENSIONS:
            view.get("extensions", {}).pop(extension, None)
        if index in free_views:
            json["bufferViews"][index] = {"buffer": 0, "byteLength": 1}  # until something takes its place
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


def _source(part: Part) -> GltfSource:
    assert isinstance(part.source, GltfSource)  # the reader made it
    return part.source


def _place(part: Part) -> Place:
    return _source(part).mesh, _source(part).primitive


def _primitive(json: Json, place: Place) -> Json:
    primitive: Json = json["meshes"][place[0]]["primitives"][place[1]]
    return primitive
