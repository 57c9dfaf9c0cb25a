"""Reads glTF 2.0: every triangle primitive of every node of the scene, placed in the world, in its rest pose."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.files.damage import check_indices, damaged
from aoprecalc.files.gltf.accessors import doubles, numbers
from aoprecalc.files.gltf.document import GltfDocument, Json, parse_gltf
from aoprecalc.files.gltf.nodes import world_matrices
from aoprecalc.files.pieces import Piece, build_scene
from aoprecalc.files.polygons import fan_triangles, strip_triangles
from aoprecalc.model import Doubles, Scene

TRIANGLES, STRIP, FAN = 4, 5, 6

# Extensions without which the positions cannot be read; where a document can do without, its plain data is used.
GEOMETRY_EXTENSIONS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
INSTANCING = "EXT_mesh_gpu_instancing"


@dataclass(frozen=True, eq=False)
class GltfSource:
    """Where a part came from and how it was placed.

    node, mesh, primitive   numbers in the document
    linear                  (3, 3) local-to-world of directions, or (n, 3, 3) for each vertex of a skinned mesh
    mirrored                the placement turns right into left, so the corners 1 and 2 of its faces were exchanged
    """

    node: int
    mesh: int
    primitive: int
    linear: Doubles
    mirrored: bool


def read_gltf(path: Path, data: bytes) -> Scene:
    """Read a glTF or GLB file of the given bytes.

    Skinned meshes stand as their joints do in the file, morph targets are not applied, points and lines are left out.

    Raises InputError where it is damaged, needs an extension that is not read, or has no usable faces.
    """
    document = parse_gltf(path, data)
    for extension in document.json.get("extensionsRequired", []):
        if extension in (*GEOMETRY_EXTENSIONS, INSTANCING):
            raise InputError(f"{path}: needs the extension {extension}, which is not read; export it without")

    matrices = world_matrices(document)
    pieces: list[Piece] = []
    others = 0
    for node_index, matrix in matrices.items():
        node = document.entry("nodes", node_index)
        if "mesh" not in node:
            continue
        mesh = document.entry("meshes", node["mesh"])
        name = node.get("name") or mesh.get("name") or f"mesh {node['mesh']}"
        for index, primitive in enumerate(mesh["primitives"]):
            if primitive.get("mode", TRIANGLES) not in (TRIANGLES, STRIP, FAN):
                others += 1
            elif "POSITION" in primitive["attributes"]:
                placement = _placement(document, node, primitive, matrix, matrices)
                piece_name = f"{name}.{index}" if len(mesh["primitives"]) > 1 else name
                pieces.append(_piece(document, primitive, piece_name, placement, (node_index, node["mesh"], index)))
    warnings = [f"{others} primitives of points or lines are left as they are"] if others else []
    return build_scene(path, path.suffix.lower().removeprefix("."), pieces, document, warnings)


def _piece(
    document: GltfDocument, primitive: Json, name: str, placement: Doubles, place: tuple[int, int, int]
) -> Piece:
    """Return one primitive placed by a (4, 4) or (n, 4, 4) matrix."""
    attributes = primitive["attributes"]
    _require_plain_data(document, primitive)
    local = doubles(document, attributes["POSITION"])
    linear = placement[..., :3, :3]
    positions = np.einsum("...ij,...j->...i", linear, local) + placement[..., :3, 3]
    vertices = _triangles(document, primitive, len(local))
    check_indices(document.path, vertices, len(local))
    mirrored = bool(np.linalg.det(linear.reshape(-1, 3, 3)[:1])[0] < 0)
    if mirrored:
        vertices = vertices[:, [0, 2, 1]]

    normals = uvs = None
    if "NORMAL" in attributes:
        turned = np.einsum("...ij,...j->...i", _cofactors(linear), doubles(document, attributes["NORMAL"]))
        normals = _per_corner(document, -turned if mirrored else turned, vertices)
    if "TEXCOORD_0" in attributes:
        uvs = _per_corner(document, doubles(document, attributes["TEXCOORD_0"]), vertices).copy()
        uvs[:, :, 1] = 1.0 - uvs[:, :, 1]
    return Piece(name, positions, vertices, normals, uvs, GltfSource(*place, linear, mirrored))


def _require_plain_data(document: GltfDocument, primitive: Json) -> None:
    """Raise InputError where the positions are only there in compressed form."""
    accessor = document.entry("accessors", primitive["attributes"]["POSITION"])
    view = document.entry("bufferViews", accessor["bufferView"]) if "bufferView" in accessor else {}
    used = {**primitive.get("extensions", {}), **view.get("extensions", {})}
    without = not view or not document.buffers[view["buffer"]]
    for extension in GEOMETRY_EXTENSIONS:
        if extension in used and without:
            raise InputError(
                f"{document.path}: its positions are there only in the form of {extension}, which is not read; "
                "export it without"
            )


def _per_corner(document: GltfDocument, values: Doubles, vertices: NDArray[np.int64]) -> Doubles:
    check_indices(document.path, vertices, len(values))
    return values[vertices]


def _triangles(document: GltfDocument, primitive: Json, count: int) -> NDArray[np.int64]:
    """Return the (f, 3) vertices of a primitive's triangles."""
    indices = np.arange(count)
    if "indices" in primitive:
        indices = numbers(document, primitive["indices"])[:, 0].astype(np.int64)
    mode = primitive.get("mode", TRIANGLES)
    if mode == STRIP:
        return strip_triangles(indices)
    if mode == FAN:
        return fan_triangles(indices)
    return indices[: len(indices) // 3 * 3].reshape(-1, 3)


def _placement(
    document: GltfDocument, node: Json, primitive: Json, matrix: Doubles, matrices: dict[int, Doubles]
) -> Doubles:
    """Return the (4, 4) local-to-world matrix of a primitive, or (n, 4, 4) for the vertices of a skinned one."""
    attributes = primitive["attributes"]
    if "skin" not in node or "JOINTS_0" not in attributes or "WEIGHTS_0" not in attributes:
        return matrix
    skin = document.entry("skins", node["skin"])
    if any(joint not in matrices for joint in skin["joints"]):
        raise damaged(document.path, f"skin {node['skin']} has joints outside the scene")
    joints = np.stack([matrices[joint] for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        inverse = doubles(document, skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        joints = joints @ inverse[: len(joints)]

    sets = [number for number in range(len(attributes)) if f"JOINTS_{number}" in attributes]
    chosen = np.hstack([numbers(document, attributes[f"JOINTS_{number}"]) for number in sets]).astype(np.int64)
    weights = np.hstack([doubles(document, attributes[f"WEIGHTS_{number}"]) for number in sets])
    if chosen.size and chosen.max() >= len(joints):
        raise damaged(document.path, f"a vertex refers to joint {chosen.max()}, but there are {len(joints)}")
    total = weights.sum(axis=1, keepdims=True)
    blended = np.einsum("nj,njab->nab", weights / np.where(total > 0, total, 1), joints[chosen])
    return np.where(total[:, :, None] > 0, blended, matrix)


def _cofactors(linear: Doubles) -> Doubles:
    """Return the (..., 3, 3) matrices that carry normals along, up to length; they exist for flat placements too."""
    a, b, c = linear[..., 0, :], linear[..., 1, :], linear[..., 2, :]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)
