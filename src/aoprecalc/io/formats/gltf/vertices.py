"""What the new vertices of a baked primitive get: UVs, values, normals, and what extensions know by their numbers."""

from collections.abc import Collection, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted, one_or_many
from aoprecalc.io.formats.base import PartSpaces, VertexOcclusion
from aoprecalc.io.formats.builder import check_indices
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, float_values, raw_values
from aoprecalc.io.formats.gltf.materials import TextureUse
from aoprecalc.io.formats.gltf.reader import PrimitiveSource, part_primitive
from aoprecalc.io.formats.gltf.references import GltfBuffer
from aoprecalc.mesh.surface import normalize
from aoprecalc.types import Float32Array, Float64Array, Part, Scene

COLOR, OCCLUSION, TANGENT = "COLOR_0", "_AO", "TANGENT"
FEATURES, OUTLINE = "EXT_mesh_features", "CESIUM_primitive_outline"


def flip_v(uvs: Float64Array) -> Float32Array:
    """Return (..., 2) UVs, v upwards, as those of glTF, v downwards."""
    return np.stack([uvs[..., 0], 1.0 - uvs[..., 1]], axis=-1).astype(np.float32)


def vertex_attribute(
    vertices: VertexOcclusion, faces: slice | NDArray[np.intp], taken: Collection[str]
) -> dict[str, Float32Array]:
    """Return the values at the corners of some faces, (n, 3, c), by the name of their attribute.

    taken   the attributes of their primitive: its colours are kept
    """
    values = vertices.corners[faces][:, :, None]
    if vertices.as_color and COLOR not in taken:
        return {COLOR: np.repeat(values, 3, axis=2)}
    return {OCCLUSION: values}


def kept_colors(path: Path, json: Json) -> Iterator[str]:
    """Yield a warning about primitives whose vertices have both colours and ambient occlusion."""
    attributes = [primitive["attributes"] for mesh in json["meshes"] for primitive in mesh["primitives"]]
    if kept := sum(COLOR in names and OCCLUSION in names for names in attributes):
        have = one_or_many(kept, "has", "have")
        yield f"{path}: {counted(kept, 'primitive')} {have} {COLOR} already, which is kept: the AO is {OCCLUSION} there"


def perpendicular(tangents: Float64Array, normals: Float32Array) -> Float32Array:
    """Return (..., 4) tangents made perpendicular to (..., 3) normals; w stays, and so do tangents along normals."""
    along = np.einsum("...i,...i->...", tangents[..., :3], normals)[..., None]
    turned = tangents[..., :3] - along * normals
    lengths = np.linalg.norm(turned, axis=-1, keepdims=True)
    turned = np.where(lengths > 1e-6, turned / np.where(lengths > 1e-6, lengths, 1), tangents[..., :3])
    return np.concatenate([turned, tangents[..., 3:]], axis=-1).astype(np.float32)


def local_normals(source: PrimitiveSource, part: Part, normals: Float32Array) -> Float32Array:
    """Transform world normals to the primitive's space: the transpose inverts the cofactor matrix, up to length."""
    linear = source.linear[part.vertices] if source.linear.ndim == 3 else source.linear
    local = np.einsum("...ij,...i->...j", linear, normals.astype(np.float64))
    lengths = np.linalg.norm(local, axis=2, keepdims=True)
    return np.where(lengths > 0, local / np.where(lengths > 0, lengths, 1), normals).astype(np.float32)


def local_tangents(source: PrimitiveSource, part: Part, tangents: Float32Array) -> Float32Array:
    """Transform world tangents, (n, 3, 4), to the primitive's space; their signs stay."""
    linear = source.linear[part.vertices] if source.linear.ndim == 3 else source.linear
    local = np.einsum("...ij,...j->...i", np.linalg.pinv(linear), tangents[..., :3].astype(np.float64))
    units = np.where(np.linalg.norm(local, axis=2, keepdims=True) > 0, normalize(local), tangents[..., :3])
    return np.concatenate([units, tangents[..., 3:]], axis=2).astype(np.float32)


def part_spaces(document: GltfDocument, scene: Scene, part: Part) -> PartSpaces:
    """Return the transform of a part's node, its tangents in the scene, and the UVs of its normalTexture."""
    source, primitive = part.source, part_primitive(document, part)
    assert isinstance(source, PrimitiveSource)  # the reader made it
    linear = source.linear[part.vertices] if source.linear.ndim == 3 else source.linear
    tangents = uvs = None
    if {"NORMAL", TANGENT} <= primitive["attributes"].keys():
        values = float_values(document, primitive["attributes"][TANGENT])
        check_indices(document.path, part.vertices, len(values))
        local = values[part.vertices]
        world = normalize(np.einsum("...ij,...j->...i", linear, local[..., :3]))
        tangents = np.concatenate([world, local[..., 3:]], axis=2)
    material = document.entry("materials", primitive["material"]) if "material" in primitive else {}
    if "normalTexture" in material:
        use = TextureUse.of(material["normalTexture"])
        uvs = scene.uv_sets[use.texcoord][part.faces] if use.texcoord < len(scene.uv_sets) else None
    return PartSpaces(linear, tangents, uvs)


def name_features(buffer: GltfBuffer, primitive: Json, vertices: NDArray[Any]) -> None:
    """Store implicit feature ids, those of EXT_mesh_features that are numbers of vertices, as an attribute.

    vertices   of the original primitive, (n,) for each new vertex
    """
    features = primitive.get("extensions", {}).get(FEATURES, {}).get("featureIds", [])
    implicit = [feature for feature in features if feature.keys().isdisjoint(("attribute", "texture"))]
    if not implicit or np.array_equal(vertices, np.arange(len(vertices))):
        return
    number = next(number for number in count() if f"_FEATURE_ID_{number}" not in primitive["attributes"])
    primitive["attributes"][f"_FEATURE_ID_{number}"] = buffer.add_ids(vertices)
    for feature in implicit:
        feature["attribute"] = number


def move_outline(
    document: GltfDocument, buffer: GltfBuffer, primitive: Json, before: NDArray[Any], after: NDArray[Any]
) -> None:
    """Store the edges of an outline (CESIUM_primitive_outline) as those of new vertices.

    before, after   (f, 3) the vertices of the triangles
    """
    outline = primitive.get("extensions", {}).get(OUTLINE)
    if outline is None:
        return
    old, new = (np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) for triangles in (before, after))
    outlined = np.sort(raw_values(document, outline["indices"]).reshape(-1, 2), axis=1)
    edges = np.unique(new[np.isin(_edge_keys(old), _edge_keys(outlined))], axis=0)
    outline["indices"] = buffer.inherit(buffer.add_indices(edges), document, outline["indices"])


def _edge_keys(edges: NDArray[Any]) -> NDArray[np.int64]:
    keys: NDArray[np.int64] = edges[:, 0].astype(np.int64) << 32 | edges[:, 1].astype(np.int64)
    return keys
