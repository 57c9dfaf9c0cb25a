"""Read glTF 2.0: every triangle primitive of every node of the shown scene, in world space and rest pose."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count, takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted
from aoprecalc.io.formats.builder import MeshPiece, build_scene, check_indices, cofactors, damaged_file
from aoprecalc.io.formats.gltf.compression import decompress
from aoprecalc.io.formats.gltf.document import (
    GltfDocument,
    Json,
    float_values,
    misnamed_files,
    parse_gltf,
    raw_values,
    unknown_chunks,
)
from aoprecalc.io.formats.gltf.materials import MaterialReader, mirrored_material
from aoprecalc.io.formats.gltf.nodes import VISIBILITY, SceneNode, instance_matrices, scene_nodes
from aoprecalc.io.formats.gltf.references import check_references, unknown_extensions
from aoprecalc.io.formats.polygons import fan_triangles, strip_triangles
from aoprecalc.mesh.surface import face_normals
from aoprecalc.progress import Note
from aoprecalc.system import path_from
from aoprecalc.types import REVERSED_WINDING, Float64Array, Material, Part, Scene

TRIANGLES, STRIP, FAN = 4, 5, 6


@dataclass(frozen=True, eq=False)
class PrimitiveSource:
    """The primitive that a part comes from, and its transform.

    node, mesh, primitive   indices in the document
    linear                  (3, 3) local-to-world of directions, or (n, 3, 3) for each vertex of a skinned mesh
    """

    node: int
    mesh: int
    primitive: int
    linear: Float64Array

    @property
    def mirrored(self) -> bool:
        """The transform is a reflection, so that the corners 1 and 2 of each face were exchanged."""
        return bool(np.linalg.det(self.linear.reshape(-1, 3, 3)[:1])[0] < 0)


def part_mesh(part: Part) -> int:
    """Return the index of the mesh that a part comes from."""
    assert isinstance(part.source, PrimitiveSource)  # the reader made it
    return part.source.mesh


def part_primitive(document: GltfDocument, part: Part) -> Json:
    """Return the primitive that a part comes from."""
    assert isinstance(part.source, PrimitiveSource)  # the reader made it
    primitive: Json = document.entry("meshes", part.source.mesh)["primitives"][part.source.primitive]
    return primitive


def read_gltf(path: Path, data: bytes) -> Scene:
    """Read a glTF or GLB file of the given bytes.

    Skins and morph targets are applied with the joints and weights of the file; points and lines are left out.

    Raises InputError where the file is damaged, needs a package that is missing, or has no usable faces.
    """
    parsed = parse_gltf(path, data)
    document = decompress(parsed)
    check_references(path, document.json)
    nodes = scene_nodes(document)
    materials = MaterialReader(document)
    pieces, skipped, hidden = _pieces(document, nodes, materials)
    messages: list[str] = [*materials.warnings, *_messages(path, document.json)]
    if document is not parsed:
        messages.append(Note("the meshes of the file are compressed, those of a baked copy are not"))
    if others := unknown_chunks(path, data):
        messages.append(f"{path} has {counted(others, 'chunk')} beside JSON and BIN, which a baked copy lacks")
    if skipped:
        messages.append(Note(f"{counted(skipped, 'primitive')} of points or lines: not baked"))
    if hidden:
        told = f"{counted(hidden, 'mesh', 'meshes')} of hidden nodes ({VISIBILITY})"
        if not pieces:
            raise InputError(f"{path}: all its faces are in {told}; show those that are to be baked")
        messages.append(Note(f"{told}: left out, neither baked nor in the way of light"))
    scene = build_scene(path, path.suffix.lower().removeprefix("."), pieces, document, messages)
    return replace(scene, parts=_instances(scene.parts, nodes))


def read_posed(scene: Scene, document: GltfDocument) -> Scene:
    """Return a scene whose nodes stand as in another document: the same faces, and the same corners of each.

    The order of corners is that of the scene, also where the pose mirrors a part. The scene has no document.
    """
    pieces = [piece for piece in _pieces(document, scene_nodes(document))[0] if len(piece.vertices)]
    pieces = [
        piece if _mirrored(piece.source) == _mirrored(part.source) else _turned(piece)
        for piece, part in zip(pieces, scene.parts, strict=True)
    ]
    posed = build_scene(scene.path, scene.format, pieces)
    return replace(
        scene,
        positions=posed.positions,
        faces=posed.faces,
        normals=posed.normals,
        document=None,
        warnings=(),
        notes=(),
    )


def _mirrored(source: object) -> bool:
    assert isinstance(source, PrimitiveSource)  # the reader made it
    return source.mirrored


def _turned(piece: MeshPiece) -> MeshPiece:
    """Return a piece with the corners 1 and 2 of each face exchanged."""
    normals = None if piece.normals is None else piece.normals[:, REVERSED_WINDING]
    return replace(piece, vertices=piece.vertices[:, REVERSED_WINDING], normals=normals)


def _pieces(
    document: GltfDocument, nodes: dict[int, SceneNode], materials: MaterialReader | None = None
) -> tuple[list[MeshPiece], int, int]:
    """Return the primitives that are shown, and how many have no triangles, and how many meshes are hidden.

    materials   None: plain ones
    """
    pieces: list[MeshPiece] = []
    skipped = hidden = 0
    for number, scene_node in nodes.items():
        node = document.entry("nodes", number)
        if "mesh" not in node:
            continue
        if scene_node.hidden:
            hidden += 1
            continue
        mesh = document.entry("meshes", node["mesh"])
        name = node.get("name") or mesh.get("name") or f"mesh {node['mesh']}"
        for index, primitive in enumerate(mesh["primitives"]):
            if primitive.get("mode", TRIANGLES) not in (TRIANGLES, STRIP, FAN):
                skipped += 1
            elif "POSITION" in primitive["attributes"]:
                shape = _shape(document, node, mesh, primitive)
                own_name = f"{name}.{index}" if len(mesh["primitives"]) > 1 else name
                names, material = {own_name, mesh.get("name"), *scene_node.names}, Material()
                if materials is not None:
                    names.add(materials.name(primitive))
                    material = materials.material(primitive, shape.vertices)
                for matrix in _transforms(document, node, primitive, nodes, number):
                    source = PrimitiveSource(number, node["mesh"], index, matrix[..., :3, :3])
                    pieces.append(_piece(document, own_name, names, shape, matrix, source, material))
    return pieces, skipped, hidden


def _messages(path: Path, json: Json) -> Iterator[str]:
    """Yield warnings and notes about what is not read, or not from where the file says."""
    scenes = json.get("scenes", [])
    if len(scenes) > 1:
        shown = json.get("scene", 0)
        yield Note(f"the file has {len(scenes)} scenes; the one that it shows (index {shown}) is baked")
    if unknown := unknown_extensions(json.get("extensionsRequired", [])):
        yield f"the file requires {', '.join(unknown)}, which is not supported and has no effect on the bake"
    for uri, file in misnamed_files(path, json):
        where = path_from(file, path.parent)
        yield f"{path} refers to {uri[:60]!a}, which is read from {where!a}; other programs may not find it"


def _instances(parts: tuple[Part, ...], nodes: dict[int, SceneNode]) -> tuple[Part, ...]:
    """Set Part.lod; and instance_of, duplicate_of: the first part of the same primitive, anywhere and in its node."""
    first: dict[tuple[int, ...], int] = {}
    result = []
    for index, part in enumerate(parts):
        source = part.source
        assert isinstance(source, PrimitiveSource)
        anywhere = first.setdefault((source.mesh, source.primitive), index)
        same_node = first.setdefault((source.mesh, source.primitive, source.node), index)
        earlier = [None if other == index else other for other in (anywhere, same_node)]
        lod = nodes[source.node].lod
        result.append(replace(part, instance_of=earlier[0], duplicate_of=earlier[1], lod=lod))
    return tuple(result)


@dataclass(frozen=True, eq=False)
class _Shape:
    """A primitive in its own space: positions and normals (n, 3), UV sets (n, 2), and triangles (f, 3)."""

    positions: Float64Array
    normals: Float64Array | None
    uv_sets: tuple[Float64Array, ...]
    vertices: NDArray[np.int64]


def _shape(document: GltfDocument, node: Json, mesh: Json, primitive: Json) -> _Shape:
    """Return a primitive with its morph targets applied by the weights of the file."""
    attributes = primitive["attributes"]
    weights = morph_weights(node, mesh)
    positions = _morphed(document, primitive, "POSITION", weights)
    normals = _morphed(document, primitive, "NORMAL", weights) if "NORMAL" in attributes else None
    names = (f"TEXCOORD_{number}" for number in count())
    sets = takewhile(lambda name: name in attributes, names)
    uv_sets = tuple(float_values(document, attributes[name]) * (1, -1) + (0, 1) for name in sets)
    vertices = _triangles(document, primitive, len(positions))
    for values in (positions, *uv_sets, *(() if normals is None else (normals,))):
        check_indices(document.path, vertices, len(values))
    return _Shape(positions, normals, uv_sets, vertices)


def morph_weights(node: Json, mesh: Json) -> list[float]:
    """Return the weights of the morph targets of a node's mesh in the pose of the file; missing ones are 0."""
    weights: list[float] = node["weights"] if "weights" in node else mesh.get("weights", [])
    return weights


def _morphed(document: GltfDocument, primitive: Json, name: str, weights: list[float]) -> Float64Array:
    """Return an attribute plus its weighted morph targets."""
    values = float_values(document, primitive["attributes"][name])
    for target, weight in zip(primitive.get("targets", []), weights, strict=False):
        if weight and name in target:
            difference = float_values(document, target[name])
            if len(difference) != len(values):
                raise damaged_file(
                    document.path,
                    f"a morph target has {counted(len(difference), 'vertex', 'vertices')}, {len(values)} were expected",
                )
            values = values + weight * difference
    return values


def _piece(
    document: GltfDocument,
    name: str,
    names: set[str | None],
    shape: _Shape,
    matrix: Float64Array,
    source: PrimitiveSource,
    material: Material,
) -> MeshPiece:
    """Return a primitive transformed by a (4, 4) matrix or by (n, 4, 4), one for each vertex."""
    linear, vertices = source.linear, shape.vertices
    positions = np.einsum("...ij,...j->...i", linear, shape.positions) + matrix[..., :3, 3]
    if source.mirrored:
        vertices, material = vertices[:, REVERSED_WINDING], mirrored_material(material)
    if shape.normals is None:  # the specification asks for flat normals then
        normals = np.repeat(face_normals(positions[vertices])[0][:, None], 3, axis=1)
    else:
        transformed = np.einsum("...ij,...j->...i", cofactors(linear), shape.normals)
        normals = (-transformed if source.mirrored else transformed)[vertices]
    uv_sets = tuple(values[vertices] for values in shape.uv_sets)
    return MeshPiece(name, positions, vertices, normals, uv_sets, source, names, material)


def _triangles(document: GltfDocument, primitive: Json, count: int) -> NDArray[np.int64]:
    """Return the (f, 3) vertices of a primitive's triangles."""
    indices = np.arange(count)
    if "indices" in primitive:
        indices = raw_values(document, primitive["indices"])[:, 0].astype(np.int64)
    mode = primitive.get("mode", TRIANGLES)
    if mode == STRIP:
        return strip_triangles(indices)
    if mode == FAN:
        return fan_triangles(indices)
    return indices[: len(indices) // 3 * 3].reshape(-1, 3)


def _transforms(
    document: GltfDocument, node: Json, primitive: Json, nodes: dict[int, SceneNode], number: int
) -> Iterator[Float64Array]:
    """Yield the (4, 4) local-to-world matrices of a primitive, or (n, 4, 4) for the vertices of a skinned one."""
    attributes, matrix = primitive["attributes"], nodes[number].matrix
    if "skin" in node and "JOINTS_0" in attributes and "WEIGHTS_0" in attributes:
        yield _skinned(document, node, attributes, matrix, nodes)
        return
    instances = instance_matrices(document, node)
    yield from [matrix] if instances is None else matrix @ instances


def _skinned(
    document: GltfDocument, node: Json, attributes: Json, matrix: Float64Array, nodes: dict[int, SceneNode]
) -> Float64Array:
    """Return the (n, 4, 4) skinning matrices of the vertices of a primitive."""
    skin = document.entry("skins", node["skin"])
    if any(joint not in nodes for joint in skin["joints"]):
        raise damaged_file(document.path, f"skin {node['skin']} has joints outside the scene")
    joints = np.stack([nodes[joint].matrix for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        inverse = float_values(document, skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        joints = joints @ inverse[: len(joints)]

    sets = [number for number in range(len(attributes)) if f"JOINTS_{number}" in attributes]
    chosen = np.hstack([raw_values(document, attributes[f"JOINTS_{number}"]) for number in sets]).astype(np.int64)
    weights = np.hstack([float_values(document, attributes[f"WEIGHTS_{number}"]) for number in sets])
    if chosen.size and chosen.max() >= len(joints):
        raise damaged_file(document.path, f"a vertex refers to joint {chosen.max()}, but there are {len(joints)}")
    total = weights.sum(axis=1, keepdims=True)
    blended = np.einsum("nj,njab->nab", weights / np.where(total > 0, total, 1), joints[chosen])
    return np.where(total[:, :, None] > 0, blended, matrix)
